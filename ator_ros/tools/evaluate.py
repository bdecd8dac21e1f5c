"""Evaluate refinement: execute the same situations with every policy.

Paper, section 5, Table 1.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from ator_ros.domains.domain import Domain
from ator_ros.evaluation.comparison import Settings
from ator_ros.evaluation.policies import POLICIES, USUAL
from ator_ros.evaluation.report import policy_table, prediction_table, write_report
from ator_ros.evaluation.running import (
    PARTIAL,
    RESULT,
    earlier_oracle,
    run_situations,
    write_result,
)
from ator_ros.tools.command_line import (
    RESUMES,
    add_models,
    add_parallel_options,
    add_setting,
    number,
    opened_tools,
    run_tool,
    source_of,
    whole,
)


def evaluate(
    settings: Settings,
    out: Path,
    *,
    command: str,
    situations: int = 100,
    oracle_from: Path | None = None,
) -> None:
    """Execute situations with every policy; write result and report, and print the tables.

    `command` is the command line for the result. `oracle_from` is the folder of an earlier
    evaluation of the same situations, whose oracle is used.
    """
    opened_tools(settings.source)  # reports a damaged file before the first execution
    oracles = (
        earlier_oracle(oracle_from, settings, situations) if oracle_from else [{}] * situations
    )
    records = run_situations(settings, situations=situations, folder=out)
    records = [record | oracle for record, oracle in zip(records, oracles, strict=True)]
    result = write_result(out, settings, records, command)
    for table in (policy_table(result["summary"]), prediction_table(result["summary"])):
        if len(table):
            print(table.to_string(index=False), end="\n\n")
    report = write_report(out, result)
    (out / PARTIAL).unlink(missing_ok=True)
    print(f"wrote {out / RESULT} and {report}")


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `evaluate`."""
    parser = argparse.ArgumentParser(prog="evaluate", description=__doc__)
    parser.add_argument(
        "--situations", type=whole(1), default=100, metavar="N", help="default: %(default)s"
    )
    parser.add_argument(
        "--seed", type=whole(), default=401, help="of the situations (default: %(default)s)"
    )
    oracle_source = parser.add_mutually_exclusive_group()
    oracle_source.add_argument(
        "--oracle", type=whole(), metavar="K", help="also execute K headings of each open step"
    )
    oracle_source.add_argument(
        "--oracle-from", type=Path, metavar="DIR",
        help="use the oracle of an earlier evaluation of the same situations, perhaps with other "
        "models",
    )  # fmt: skip
    parser.add_argument(
        "--oracle-speeds", type=number(0.0, 10.0), nargs="+", default=[], metavar="V",
        help="also execute these arrival speeds in m/s at each of the K headings",
    )  # fmt: skip
    parser.add_argument(
        "--oracle-margin", type=number(0.0), metavar="S",
        help="skip headings predicted to take S s longer than the best one (default: execute all)",
    )  # fmt: skip
    parser.add_argument(
        "--out", type=Path, default=Path("evaluation"), metavar="DIR", help="default: %(default)s"
    )
    add_setting(parser)
    parser.add_argument("--chain", metavar="NAME", help="of the domain (default: its first)")
    parser.add_argument(
        "--policies", nargs="+", choices=tuple(POLICIES), default=USUAL, metavar="NAME",
        help="default: all but fixed, arrive, refined_place, stepwise, passing and orders",
    )  # fmt: skip
    add_models(parser)
    add_parallel_options(parser)
    return parser


def _run(options: argparse.Namespace, _: Domain, command: str) -> None:
    if options.oracle is None and (options.oracle_speeds or options.oracle_margin is not None):
        arguments().error("--oracle-speeds, --oracle-margin: expected --oracle, too")
    source = source_of(options)
    source.require_executable(options.chain)
    wanted = {"naive", *options.policies}
    settings = Settings(
        seed=options.seed,
        chain=options.chain,
        policies=tuple(name for name in POLICIES if name in wanted),
        oracle=options.oracle or 0,
        oracle_margin=options.oracle_margin,
        oracle_speeds=tuple(options.oracle_speeds),
        source=source,
    )
    evaluate(
        settings, options.out, command=command, situations=options.situations,
        oracle_from=options.oracle_from,
    )  # fmt: skip


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    return run_tool(
        arguments(), _run, argv, interrupted=RESUMES, chain=lambda domain: domain.chains
    )
