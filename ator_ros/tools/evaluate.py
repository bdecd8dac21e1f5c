"""Evaluate refinement: execute the same random situations with every policy (paper, section 5, Table 1)."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ator_ros.files import portable_command
from ator_ros.tools.command_line import (
    add_models,
    add_parallel_options,
    add_setting,
    check_names,
    policies,
    settled,
)
from ator_ros.tools.guard import RESUMES, guarded
from ator_ros.tools.option_types import number, whole

_OFFLINE = 300


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `evaluate`."""
    parser = argparse.ArgumentParser(prog="evaluate", description=__doc__)
    parser.add_argument("--situations", type=whole(), default=100, metavar="N", help="default: %(default)s")
    parser.add_argument("--seed", type=whole(), default=401, help="of the situations (default: %(default)s)")
    parser.add_argument(
        "--oracle", type=whole(), metavar="K", help="also execute K approach headings each time"
    )
    parser.add_argument(
        "--oracle-jointly",
        action="store_const",
        const=True,
        help="K headings at every open step, jointly: where the robot stands between two actions",
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
    parser.add_argument(
        "--out", type=Path, default=Path("evaluation"), metavar="DIR", help="default: %(default)s"
    )
    add_setting(parser)
    parser.add_argument("--chain", metavar="NAME", help="of the domain (default: its first)")
    parser.add_argument("--policies", nargs="+", metavar="NAME", help="default: all that can be run")
    parser.add_argument(
        "--again",
        nargs="+",
        default=[],
        metavar="NAME",
        help="execute only these policies again; the others and the oracle come from the result in --out, "
        "which the same options have made",
    )
    add_models(parser)
    parser.add_argument(
        "--experience",
        nargs="+",
        default=[],
        metavar="FILE",
        help="tables from collect, for the policy hist_gradient_boosting",
    )
    parser.add_argument(
        "--learning",
        nargs="*",
        metavar="CHANGE",
        help="play chains on robots that have changed, and learn meanwhile: none, motors, lag, wheel, roll "
        "(default: all)",
    )
    parser.add_argument(
        "--offline",
        type=whole(50),
        metavar="N",
        help=f"episodes of the offline models' actions (default: {_OFFLINE})",
    )
    parser.add_argument(
        "--explore", type=number, metavar="SHARE", help="of the time, to try the unknown (default: 0)"
    )
    add_parallel_options(parser)
    return parser


def _refuse_idle(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """Refuse options that do nothing without another one."""
    for needed, names in (
        ("oracle", ("oracle_jointly", "oracle_speeds", "oracle_margin")),
        ("learning", ("offline", "explore")),
    ):
        given = [name for name in names if getattr(options, name) not in (None, [])]
        if given and getattr(options, needed) is None:
            parser.error(f"--{given[0].replace('_', '-')}: expected --{needed}, too")
    if options.oracle_jointly and options.oracle_speeds:
        parser.error("--oracle-speeds: expected none beside --oracle-jointly")


def _fill_in(options: argparse.Namespace) -> None:
    options.oracle, options.oracle_jointly = options.oracle or 0, bool(options.oracle_jointly)
    options.offline = _OFFLINE if options.offline is None else options.offline
    options.explore = options.explore or 0.0


def _speed(text: str) -> float:
    value = float(text)
    if not 0.0 <= value <= 10.0:
        raise argparse.ArgumentTypeError(f"expected a speed from 0 to 10 m/s, got {text}")
    return value


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    parser = arguments()
    options, _ = settled(parser, words, chain=lambda domain: domain.chains)
    if options.policies is not None:
        check_names(parser, "policies", options.policies, policies())
    _refuse_idle(parser, options)
    _fill_in(options)

    def run() -> int:
        if options.learning is not None:
            from ator_ros.tools.work import evaluate_learning

            return evaluate_learning.run(options, portable_command("evaluate", words))
        from ator_ros.tools.work import evaluate as work

        return work.run(options, portable_command("evaluate", words))

    return guarded("evaluate", run, interrupted=RESUMES)


if __name__ == "__main__":
    sys.exit(main())
