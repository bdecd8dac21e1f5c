"""Play chains of a domain naive and refined, over ROS (paper, Figure 1)."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ator_ros.tools.command_line import add_factor, add_models, add_setting, settled
from ator_ros.tools.option_types import destination, whole

_LONGEST_DEMO = 200  # situations of which one page shows all pictures


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `demo`."""
    parser = argparse.ArgumentParser(prog="demo", description=__doc__)
    parser.add_argument(
        "--situations", type=whole(1, _LONGEST_DEMO), default=6, metavar="N", help="default: %(default)s"
    )
    parser.add_argument("--seed", type=whole(), default=401, help="of the situations (default: %(default)s)")
    add_setting(parser, action_set=False)
    parser.add_argument("--chain", metavar="NAME", help="of the domain (default: its last)")
    add_factor(parser, 0.0)
    add_models(parser)
    parser.add_argument(
        "--out",
        type=destination,
        default=Path("build/demo.png"),
        metavar="FILE.png",
        help="default: %(default)s",
    )
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    options, domain = settled(arguments(), argv, chain=lambda domain: reversed(list(domain.chains)))
    from ator_ros.tools.work import demo as work

    return work.run(options, domain)


if __name__ == "__main__":
    sys.exit(main())
