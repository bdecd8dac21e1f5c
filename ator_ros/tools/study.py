"""Study a robot in one folder: collect experience, train models, learn the gate, evaluate, report.

The same command resumes where it was interrupted: what is finished in the folder is not made again.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ator_ros.files import portable_command
from ator_ros.tools.command_line import add_jobs, add_setting, settled
from ator_ros.tools.guard import RESUMES, guarded
from ator_ros.tools.option_types import whole


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `study`."""
    parser = argparse.ArgumentParser(prog="study", description=__doc__)
    add_setting(parser)
    parser.add_argument(
        "--episodes", type=whole(20), default=1000, metavar="N",
        help="of each action, at least 20 (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--situations", type=whole(10), default=200, metavar="M",
        help="that the gate is learned from, and others that the evaluation executes; at least 10 "
        "(default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--seed", type=whole(), default=1, metavar="S",
        help="of the episodes; fresh episodes, the gate and the evaluation take the three after it",
    )  # fmt: skip
    parser.add_argument("--chain", metavar="NAME", help="to evaluate (default: the domain's first)")
    parser.add_argument(
        "--oracle", type=whole(), default=24, metavar="K",
        help="headings of the first subgoal that the oracle executes (default: %(default)s)",
    )  # fmt: skip
    add_jobs(parser)
    parser.add_argument("--out", type=Path, default=Path("study"), metavar="DIR", help="default: %(default)s")
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    options, domain = settled(arguments(), words, needed=False, chain=lambda domain: domain.chains)

    def run() -> int:
        from ator_ros.tools.work import study as work

        return work.run(options, domain, portable_command("study", words))

    return guarded("study", run, interrupted=RESUMES)


if __name__ == "__main__":
    sys.exit(main())
