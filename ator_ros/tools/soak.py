"""Run chains back to back over ROS for a set time, and compare the nodes at the end with the beginning.

At real time (--real-time-factor 1) the punctuality of ticks and the nodes' CPU are judged, too. The exit
code is 1 where something is worse than it should be; what has been seen is written every minute.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ator_ros.files import portable_command
from ator_ros.tools.command_line import add_factor, add_models, add_setting, settled
from ator_ros.tools.guard import guarded
from ator_ros.tools.option_types import destination, number, whole


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `soak`."""
    parser = argparse.ArgumentParser(prog="soak", description=__doc__)
    parser.add_argument("--duration", type=number, default=120.0, metavar="S", help="default: %(default)s")
    add_factor(parser, 0.0)
    parser.add_argument("--seed", type=whole(), default=701)
    add_setting(parser)
    add_models(parser)
    parser.add_argument("--chain", metavar="NAME", help="of the domain (default: its first)")
    parser.add_argument(
        "--out",
        type=destination,
        default=Path("build/soak.json"),
        metavar="FILE.json",
        help="default: %(default)s",
    )
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; the exit code is 1 where something is worse than it should be."""
    words = list(sys.argv[1:] if argv is None else argv)
    options, domain = settled(arguments(), words, chain=lambda domain: domain.chains)

    def run() -> int:
        from ator_ros.tools.work import soak as work

        return work.run(options, domain, portable_command("soak", words))

    return guarded("soak", run, interrupted="what was written last is kept")


if __name__ == "__main__":
    sys.exit(main())
