"""Play the paper's chain (go to the ball, dribble, shoot) naive and refined, over ROS (paper, Figure 1)."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ator_ros.tools.command_line import add_factor, add_models
from ator_ros.tools.option_types import destination, whole

_LONGEST_DEMO = 200


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `demo`."""
    parser = argparse.ArgumentParser(prog="demo", description=__doc__)
    parser.add_argument(
        "--situations", type=whole(1, _LONGEST_DEMO), default=6, metavar="N", help="default: %(default)s"
    )
    parser.add_argument("--seed", type=whole(), default=401, help="of the situations (default: %(default)s)")
    parser.add_argument(
        "--robot", default="", metavar="FILE", help="robot description (default: the shipped one)"
    )
    add_factor(parser, 0.0)
    add_models(parser)
    parser.add_argument("--out", type=destination, default=Path("build/demo.png"), metavar="FILE.png")
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    options = arguments().parse_args(argv)
    from ator_ros.tools.work import demo as work

    return work.run(options)


if __name__ == "__main__":
    sys.exit(main())
