"""Learn performance models and the gate from experience; show rules and accuracy (paper, sections 3, 5)."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ator_ros.files import portable_command
from ator_ros.tools.command_line import add_setting, settled
from ator_ros.tools.guard import guarded
from ator_ros.tools.option_types import destination, topic


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `train`."""
    parser = argparse.ArgumentParser(prog="train", description=__doc__)
    parser.add_argument(
        "experience", nargs="*", type=Path, help="tables of collect, or recordings (.mcap or their folders)"
    )
    parser.add_argument(
        "--fresh",
        nargs="+",
        type=Path,
        default=[],
        help="other episodes, on which accuracy is measured (alone: of the models there are)",
    )
    add_setting(parser, action_set=False)
    parser.add_argument("--models", type=Path, help="folder of the models (default: the shipped models/)")
    parser.add_argument(
        "--action-set",
        metavar="NAME",
        help="of odometry and commands that were recorded (tables and records know their own)",
    )
    parser.add_argument(
        "--no-gate",
        action="store_true",
        help="do not learn the gate from the same episodes (`gate` learns one from executed chains)",
    )
    parser.add_argument(
        "--odom", type=topic, metavar="TOPIC",
        help="of odometry in recordings (default: odom in any namespace)",
    )  # fmt: skip
    parser.add_argument(
        "--cmd-vel", type=topic, metavar="TOPIC",
        help="of velocity commands in recordings (default: cmd_vel in any namespace)",
    )  # fmt: skip
    parser.add_argument(
        "--ablation", type=destination, metavar="FILE", help="write the feature ablation as Markdown"
    )
    parser.add_argument(
        "--report", type=destination, metavar="FILE", help="write the accuracy of all models there are"
    )
    parser.add_argument(
        "--rules",
        metavar="MODEL",
        help="print the rules of a model, given by its action or file, and stop",
    )
    parser.add_argument(
        "--observed",
        action="store_true",
        help="learn from odometry, goals and results alone, without ideal times of our own actions",
    )
    parser.add_argument("--measure", default="duration", help="whose rules (default: %(default)s)")
    parser.add_argument(
        "--situation", nargs="+", metavar="NAME=VALUE",
        help="with --rules: only the rule for one situation, of direct variables such as xg=1.5 yawg=1.57; "
        "angles in rad",
    )  # fmt: skip
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    parser = arguments()
    options, domain = settled(parser, words)
    if not (options.experience or options.fresh or options.rules or options.report):
        parser.error("expected experience to learn from, --fresh, --rules or --report")

    def run() -> int:
        from ator_ros.tools.work import train as work

        return work.run(options, domain, portable_command("train", words))

    return guarded("train", run, interrupted="models whose lines were printed are written, no others")


if __name__ == "__main__":
    sys.exit(main())
