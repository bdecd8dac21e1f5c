"""Show robot, chains and what refinement says of them on a page in the browser, and let them be changed.

With a recording it is played instead: odometry, objects, and the executed chains, predicted against actual.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ator_ros.tools.command_line import add_factor, add_models, add_setting, frame, namespace, whole

_PORTS = (1024, 65535)  # below, only root may listen


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `view`."""
    parser = argparse.ArgumentParser(
        prog="view", description=__doc__, usage="%(prog)s [options] [EVALUATION | RECORDING] [--ros-args ...]"
    )
    parser.add_argument(
        "shown",
        nargs="?",
        type=Path,
        metavar="EVALUATION | RECORDING",
        help="folder of an evaluation, whose worst runs can be chosen; "
        "or a recording of ros2 bag record -s mcap, a folder or a file",
    )
    parser.add_argument("--port", type=whole(*_PORTS), default=8080, help="default: %(default)s")
    parser.add_argument(
        "--host", default="127.0.0.1", help="address to serve at (default: %(default)s: this machine only)"
    )
    parser.add_argument(
        "--attach", action="store_true", help="show nodes that run, instead of starting simulation and others"
    )
    parser.add_argument(
        "--robots",
        nargs="+",
        type=namespace,
        default=[],
        metavar="NAMESPACE",
        help="with --attach: robots to show, each with the nodes of its namespace; one is chosen on the page",
    )
    parser.add_argument(
        "--frame",
        type=frame,
        help="frame of odometry (default: odom; with --robots NAMESPACE/odom)",
    )
    add_setting(parser, action_set=False)
    add_models(parser)
    add_factor(parser, 1.0)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    own = words[: words.index("--ros-args")] if "--ros-args" in words else words
    parser = arguments()
    options = parser.parse_args(own)
    if options.robots and not options.attach:
        parser.error("--robots: expected --attach, too: what it names must run")
    if len(set(options.robots)) < len(options.robots):
        parser.error(f"--robots: expected different names, got {' '.join(options.robots)}")
    if options.shown is not None and not _is_evaluation(options.shown):
        if options.attach:
            parser.error(f"--attach: expected the folder of an evaluation beside it, got {options.shown}")
        from ator_ros.tools.work import replay

        return replay.run(options)
    from ator_ros.tools.work import view as work

    return work.run(options, words[len(own) :])


def _is_evaluation(place: Path) -> bool:
    from ator_ros.evaluation.running import RESULT  # takes long, and no help needs it

    try:
        return (place / RESULT).is_file()
    except OSError:  # too long for a name: it is reported where it is read
        return False


if __name__ == "__main__":
    sys.exit(main())
