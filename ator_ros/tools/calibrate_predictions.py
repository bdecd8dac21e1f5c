"""Learn, or report, what predictions of actions in chains miss, from the chains that `evaluate` executed."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ator_ros.files import portable_command
from ator_ros.tools.command_line import add_models, add_setting, settled
from ator_ros.tools.guard import guarded
from ator_ros.tools.option_types import destination


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `calibrate_predictions`."""
    parser = argparse.ArgumentParser(prog="calibrate_predictions", description=__doc__)
    parser.add_argument(
        "evaluations",
        nargs="+",
        type=Path,
        metavar="DIR",
        help="folders that evaluate has written, with the policies naive, refined, refined_speed",
    )
    add_setting(parser, action_set=False)
    add_models(parser)
    parser.add_argument(
        "--actions",
        nargs="+",
        metavar="NAME",
        help="learn the corrections of these actions only; the file keeps those of the others (default: all)",
    )
    parser.add_argument(
        "--report",
        type=destination,
        metavar="FILE.md",
        help="write how far the predictions in these evaluations were off, and learn nothing",
    )
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    options, domain = settled(arguments(), words)

    def run() -> int:
        from ator_ros.tools.work import calibrate_predictions as work

        return work.run(options, domain, portable_command("calibrate_predictions", words))

    return guarded("calibrate_predictions", run)


if __name__ == "__main__":
    sys.exit(main())
