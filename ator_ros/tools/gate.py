"""Learn the gate, and refit the rulers' time models, from situations of their own (paper, section 5)."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ator_ros.files import portable_command
from ator_ros.tools.command_line import add_models, add_parallel_options, add_setting, settled
from ator_ros.tools.guard import RESUMES, guarded
from ator_ros.tools.option_types import whole


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `gate`."""
    parser = argparse.ArgumentParser(prog="gate", description=__doc__)
    parser.add_argument("--situations", type=whole(10), default=400, metavar="N", help="default: %(default)s")
    parser.add_argument("--seed", type=whole(), default=301, help="of the situations (default: %(default)s)")
    add_setting(parser)
    parser.add_argument("--chain", metavar="NAME", help="of the domain (default: its first)")
    add_models(parser)
    parser.add_argument(
        "--experience",
        nargs="+",
        metavar="FILE",
        help="tables: refit the rulers' models to them",
    )
    parser.add_argument(
        "--episodes",
        nargs="+",
        metavar="FILE",
        help="learn the gate of the observed models from the tables that they learned from; execute nothing",
    )
    parser.add_argument(
        "--draw-errors",
        action="store_true",
        help="learn a threshold from errors drawn from those of chains that gain about as much: "
        "of some hundred chains only a handful become slower",
    )
    parser.add_argument(
        "--room",
        action="store_true",
        help="choose no arrival at a speed at which the robot could not stop before a bay",
    )
    parser.add_argument(
        "--calibrate",
        action="store_true",
        help="also learn from the same chains what predictions miss, as calibrate_predictions does; "
        "the gate then judges corrected predictions",
    )
    parser.add_argument(
        "--work",
        type=Path,
        default=Path("gate"),
        metavar="DIR",
        help="for partial results (default: %(default)s)",
    )
    add_parallel_options(parser)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    options, _ = settled(arguments(), words, chain=lambda domain: domain.chains)

    def run() -> int:
        from ator_ros.tools.work import gate as work

        return work.run(options, portable_command("gate", words))

    return guarded("gate", run, interrupted=RESUMES)


if __name__ == "__main__":
    sys.exit(main())
