"""Collect experience: execute each action from random situations in the simulator (paper, section 3).

The same command continues where it was interrupted.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ator_ros.files import portable_command
from ator_ros.tools.command_line import add_factor, add_parallel_options, add_setting, settled
from ator_ros.tools.guard import RESUMES, guarded
from ator_ros.tools.option_types import destination, whole


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `collect`."""
    parser = argparse.ArgumentParser(prog="collect", description=__doc__)
    add_setting(parser)
    parser.add_argument("--actions", nargs="+", metavar="NAME", help="default: all of the domain")
    parser.add_argument("--episodes", type=whole(1), default=1000, help="per action (default: %(default)s)")
    parser.add_argument("--seed", type=whole(), default=101, help="the same seed gives the same table")
    add_parallel_options(parser)
    parser.add_argument(
        "--over-ros",
        action="store_true",
        help="drive over ROS, with the domain's action servers, and learn from the executor's records; one "
        "drive at a time, whatever --jobs says",
    )
    add_factor(parser, 0.0)
    parser.add_argument(
        "--out",
        type=_table,
        default=Path("experience.parquet"),
        metavar="FILE.parquet",
        help="default: %(default)s",
    )
    return parser


def _table(text: str) -> Path:
    path = destination(text)
    if path.suffix != ".parquet":  # by which train and evaluate know a table
        raise argparse.ArgumentTypeError(f"expected a file named .parquet, got {text!r}")
    return path


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    action_set = arguments().parse_args(words).action_set  # which need not have the actions of the others
    options, domain = settled(arguments(), words, actions=lambda domain: domain.actions(action_set))

    def run() -> int:
        from ator_ros.tools.work import collect as work

        return work.run(options, domain, portable_command("collect", words))

    return guarded("collect", run, interrupted=RESUMES)


if __name__ == "__main__":
    sys.exit(main())
