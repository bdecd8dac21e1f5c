"""Measure speeds and learners against their limits.

The parts: simulation, planning (the longest ticks), refinement (the core's), plans (from goals),
service, collection (of experience), and learners: our model tree beside others on the same rows.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ator_ros.tools.guard import guarded
from ator_ros.tools.option_types import destination

PARTS = ("simulation", "planning", "refinement", "plans", "service", "collection", "learners")
"""Each has its module in `tools.benchmarks` and its field in `BenchReport`."""


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `bench`."""
    parser = argparse.ArgumentParser(prog="bench", description=__doc__)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    for name, text in (("experience", "to learn from"), ("fresh", "to measure learners on")):
        parser.add_argument(
            f"--{name}",
            type=Path,
            default=Path(f"out/reproduce/{name}.parquet"),
            metavar="TABLE",
            help=f"table of `collect` {text}; collected if it is not there (default: %(default)s)",
        )
    parser.add_argument(
        "--out",
        type=destination,
        default=Path("docs/benchmarks.json"),
        metavar="FILE.json",
        help="keeps what it holds of other parts; the learners' table, peers.md, goes beside it "
        "(default: %(default)s)",
    )
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; the exit code is 1 where a part cannot be measured."""
    options = arguments().parse_args(argv)

    def run() -> int:
        from ator_ros.tools.work import bench as work

        return work.run(options)

    return guarded("bench", run, interrupted="the parts whose lines were printed are written")


if __name__ == "__main__":
    sys.exit(main())
