"""Measure the actions: success, regularity, and time over the time-optimal motion."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ator_ros.files import portable_command
from ator_ros.tools.command_line import add_jobs, add_setting, settled
from ator_ros.tools.guard import guarded
from ator_ros.tools.option_types import destination, whole


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `qualify`."""
    parser = argparse.ArgumentParser(prog="qualify", description=__doc__)
    parser.add_argument(
        "--situations", type=whole(1), default=1000, help="of each kind (default: %(default)s)"
    )
    parser.add_argument(
        "--turned", type=whole(), default=300, help="of them also turned by 1 degree either way"
    )
    parser.add_argument(
        "--pairs", type=whole(), default=200, help="of them compared with the time-optimal motion"
    )
    parser.add_argument("--seed", type=whole(), default=901)
    add_setting(parser)
    add_jobs(parser)
    parser.add_argument(
        "--out", type=destination, default=Path("actions.json"),
        help="a table, .md, goes beside it (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--optimal", type=Path, metavar="DIR",
        help="folder of the ruler: optimal_KIND.json (the times in s that benchmarks/time_optimal.py prints "
        "for pairs_KIND.json) is read there; without it pairs_KIND.json is written",
    )  # fmt: skip
    parser.add_argument(
        "--slices", type=destination, metavar="PNG", help="also draw duration against start heading"
    )
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    options, domain = settled(arguments(), words)

    def run() -> int:
        from ator_ros.tools.work import qualify as work

        return work.run(options, domain, portable_command("qualify", words))

    return guarded("qualify", run)


if __name__ == "__main__":
    sys.exit(main())
