"""Estimate latency, motor lag, limits and dead zone of a base from half a minute of driving.

Drives the base that listens to cmd_vel: creeps, sprints to and fro, and spins both ways. Nothing else may
command it meanwhile. The robot needs free way ahead (--space), half a metre behind, and room to turn.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ator_ros.tools.guard import guarded
from ator_ros.tools.option_types import destination, frame

_GREATEST = 1000.0  # m, m/s or rad/s; a sprint to 15 m/s needs some hundred m


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `calibrate`."""
    parser = argparse.ArgumentParser(
        prog="calibrate", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--robot", type=Path, help="description whose sizes are kept (default: the shipped one)"
    )
    parser.add_argument("--out", type=destination, required=True, help="description to write")
    parser.add_argument("--name", help="name of the robot (default: that of --robot)")
    parser.add_argument(
        "--space", type=_positive, default=3.0, help="free way ahead of the robot in m (default: %(default)s)"
    )
    parser.add_argument(
        "--v", type=_positive, help="greatest command in m/s (default: 1.5 times the limit of --robot)"
    )
    parser.add_argument(
        "--w", type=_positive, help="greatest command in rad/s (default: 1.5 times the limit of --robot)"
    )
    parser.add_argument(
        "--stamped",
        choices=("auto", "true", "false"),
        default="auto",
        help="whether cmd_vel is a TwistStamped; auto: what the base subscribes to (default: %(default)s)",
    )
    parser.add_argument(
        "--frame", type=frame, default="odom", help="frame of the odometry (default: %(default)s)"
    )
    return parser


def _positive(text: str) -> float:
    value = float(text)
    if not 0.0 < value <= _GREATEST:
        raise argparse.ArgumentTypeError(f"expected a number above 0, at most {_GREATEST:g}, got {text!r}")
    return value


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    own = words
    if "--ros-args" in words:
        from rclpy.utilities import remove_ros_args

        own = remove_ros_args(["calibrate", *words])[1:]
    options = arguments().parse_args(own)

    def run() -> int:
        from ator_ros.tools.work import calibrate as work

        return work.run(options, words)

    return guarded("calibrate", run)


if __name__ == "__main__":
    sys.exit(main())
