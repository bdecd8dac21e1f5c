"""Evaluate refinement: execute the same random situations with every policy (paper, section 5, Table 1)."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ator_ros.domains.domain import Domain
from ator_ros.evaluation.errors import EvaluationError
from ator_ros.evaluation.policies import POLICIES
from ator_ros.evaluation.running import RESUMES, describe, prediction_text, table_text
from ator_ros.evaluation.situation import Settings
from ator_ros.evaluation.storage import PartialResults, write_result
from ator_ros.evaluation.toolset import ToolsetSource, available_policies, make_toolset
from ator_ros.files import portable_command
from ator_ros.report.evaluation_page import write_report
from ator_ros.tools.command_line import add_domain, add_parallel_options, domain_in, executed, guarded, whole


def arguments(domain: Domain) -> argparse.ArgumentParser:
    """Return the command line of `evaluate`."""
    parser = argparse.ArgumentParser(prog="evaluate", description=__doc__)
    parser.add_argument("--situations", type=whole(), default=100, metavar="N")
    parser.add_argument("--seed", type=whole(), default=401, help="of the situations (default: %(default)s)")
    parser.add_argument(
        "--oracle", type=whole(), default=0, metavar="K", help="also execute K approach headings each time"
    )
    parser.add_argument(
        "--oracle-speeds",
        type=_speed,
        nargs="+",
        default=[],
        metavar="V",
        help="also execute these arrival speeds in m/s at each of the K headings",
    )
    parser.add_argument(
        "--oracle-margin",
        type=float,
        metavar="S",
        help="leave out what is predicted to take S s longer than the best (default: execute all)",
    )
    parser.add_argument("--out", type=Path, default=Path("evaluation"), metavar="DIR")
    add_domain(parser)
    chains = list(domain.chains)
    parser.add_argument("--chain", choices=chains, default=chains[0])
    parser.add_argument("--action-set", choices=list(domain.action_sets), default="default")
    parser.add_argument("--policies", nargs="+", choices=list(POLICIES), help="default: all that can be run")
    parser.add_argument("--models", default="", metavar="DIR", help="folder of models (default: as shipped)")
    parser.add_argument(
        "--experience",
        nargs="+",
        default=[],
        metavar="FILE",
        help="tables from collect, for the policy hist_gradient_boosting",
    )
    add_parallel_options(parser)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; give the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    options = arguments(domain_in("evaluate", words)).parse_args(words)
    command = portable_command("evaluate", words)
    return guarded("evaluate", lambda: _evaluate(options, command), interrupted=RESUMES)


def _evaluate(options: argparse.Namespace, command: str) -> int:
    if options.situations < 1:
        raise EvaluationError(f"--situations: expected at least 1, got {options.situations}")
    source = ToolsetSource(
        domain=options.domain,
        action_set=options.action_set,
        models=options.models,
        experience=tuple(options.experience),
    )
    tools = make_toolset(source)  # before anything is executed: a damaged file shall be told at once
    policies, missing = available_policies(source)
    for name, why in missing.items():
        if options.policies is None:
            print(f"evaluate: without the policy {name}: {why}", file=sys.stderr)
        elif name in options.policies:
            raise EvaluationError(f"--policies: {name} cannot be run: {why}")
    wanted = policies if options.policies is None else tuple(options.policies)
    settings = Settings(
        seed=options.seed,
        chain=options.chain,
        policies=tuple(name for name in POLICIES if name in {*wanted, "naive"}),
        oracle=options.oracle,
        oracle_margin=options.oracle_margin,
        oracle_speeds=tuple(options.oracle_speeds),
        source=source,
    )
    records = executed(settings, options, options.out)
    result = describe(settings, records, command)
    path = write_result(options.out, result, records)
    print(table_text(result["summary"]))
    print(prediction_text(result["summary"]))
    report = write_report(options.out, result, records, settings, tools)
    PartialResults.remove(options.out)
    print(f"wrote {path} and {report}")
    return 0


def _speed(text: str) -> float:
    value = float(text)
    if not 0.0 <= value <= 10.0:
        raise argparse.ArgumentTypeError(f"expected a speed from 0 to 10 m/s, got {text}")
    return value


if __name__ == "__main__":
    sys.exit(main())
