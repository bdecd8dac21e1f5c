"""Print the chains of TOPs that bring about a goal, with their predictions; the best comes first.

A goal is a name of the domain's, or statements that shall all hold: VARIABLE=VALUE, as near as the TOPs
bring it, or VARIABLE=VALUE:LOW:HIGH, LOW to HIGH about it. VALUE is a number or another variable, as in
object.x=hold.x:-0.1:0.1.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from ator_ros.tools.command_line import add_models, add_setting, settled
from ator_ros.tools.guard import guarded
from ator_ros.tools.option_types import finite


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `plan`."""
    parser = argparse.ArgumentParser(prog="plan", description=__doc__)
    parser.add_argument(
        "goal", nargs="*", metavar="GOAL", help="a name, or statements; none: print the names"
    )
    parser.add_argument(
        "--at", nargs=3, type=finite, default=[0.0, 0.0, 0.0], metavar=("X", "Y", "YAW"),
        help="where the robot stands, in m and rad (default: the origin)",
    )  # fmt: skip
    parser.add_argument(
        "--object", nargs=3, action="append", default=[], metavar=("NAME", "X", "Y"),
        help="an object, and where it lies in m; once for each",
    )  # fmt: skip
    add_setting(parser)
    add_models(parser)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; the exit code is 1 where there is no plan."""
    options, domain = settled(arguments(), argv)

    def run() -> int:
        from ator_ros.tools.work import plan as work

        return work.run(options, domain)

    return guarded("plan", run)


if __name__ == "__main__":
    sys.exit(main())
