"""Estimate latency, motor lag, limits and dead zone of a base from half a minute of driving.

Drives the base that subscribes to cmd_vel: slowly, at full speed forward and back, and turning in
both directions. No other program may command it meanwhile. The robot needs free space ahead
(--space), 0.5 m behind, and room to turn.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import sys
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import rclpy
import yaml
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from ator_ros.bases.description import KIND, Robot, load_robot, robot_of
from ator_ros.bases.differential.calibration import calibrated, probe_drive
from ator_ros.bases.differential.probe_drive import DriveError, ProbeDrive
from ator_ros.files import header, portable_command, write_text
from ator_ros.nodes.commands import CommandPublisher
from ator_ros.nodes.diagnostics import Diagnosis
from ator_ros.nodes.main_loop import uninterrupted
from ator_ros.nodes.network import stay_on_this_machine
from ator_ros.nodes.parameters import FRAME, ROBOT_FRAME, STATE
from ator_ros.nodes.subscriptions import Subscriptions
from ator_ros.tools.command_line import destination, guarded, number, without_ros_arguments
from ator_ros.world.readers import plain_frame
from ator_ros.world.state import STOP, RobotState

_LEAST = 0.001  # m, m/s or rad/s
_MOST = 1000.0  # the same; a sprint to 15 m/s needs some hundred m
_ODOM_TIMEOUT = 2.0  # real s without odometry after which the drive is aborted
_START_TIMEOUT = 5.0  # real s to wait for odometry
_STOPS = 10  # stop commands at the end, because DDS may lose some


def calibrate(options: argparse.Namespace, words: Sequence[str]) -> None:
    """Drive the base that subscribes to cmd_vel, and write a description with the estimates.

    `options` are those of `arguments`, `words` the whole command line with arguments for ROS.
    Raises DriveError if odometry is missing, another program commands the base, the base does not
    move, or an estimate cannot be right: then nothing is written.
    """
    template = load_robot(options.robot)
    drive = probe_drive(template, v=options.v, w=options.w, space=options.space)
    stay_on_this_machine(os.environ)
    # rclpy's own handlers would invalidate the context before the robot has been stopped.
    rclpy.init(args=["calibrate", *words], signal_handler_options=SignalHandlerOptions.NO)
    node = Node("calibrate")
    try:
        _Driver(node, drive, template, options).run()
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    named = dataclasses.replace(template, name=options.name or template.name)
    robot, lines = calibrated(named, drive.samples)
    comments = ("Written by:", portable_command("calibrate", words), *lines)
    text = yaml.safe_dump(robot.sections(), sort_keys=False)
    robot_of(yaml.safe_load(text))  # raises SchemaError if an estimate is out of bounds
    text = yaml.safe_dump(header(KIND), sort_keys=False) + text
    write_text(options.out, "".join(f"# {line}\n" for line in comments) + text)
    print("\n".join((*lines, f"written to {options.out}")))


class _Driver:
    """Publishes a command of the drive for each odometry message."""

    def __init__(
        self, node: Node, drive: ProbeDrive, robot: Robot, options: argparse.Namespace
    ) -> None:
        self._node = node
        self._drive = drive
        self._commands = CommandPublisher(node, stamped=options.stamped, frame="base_link")
        self._received: float | None = None  # real s
        self._stamp = -1.0  # s, of the newest odometry
        self._done = False
        warn = partial(node.get_logger().warning, throttle_duration_sec=_ODOM_TIMEOUT)
        settings = {FRAME.name: options.frame, ROBOT_FRAME.name: "base_link", STATE.name: "odom"}
        subscriptions = Subscriptions(
            node, settings, robot, (),
            take_robot=self._take_robot, take_object=lambda *_: None, warn=warn,
        )  # fmt: skip
        self._diagnosis = Diagnosis(node, subscriptions)

    def run(self) -> None:
        """Drive until all speeds were measured; raises DriveError."""
        start = time.monotonic()
        try:
            while not self._done:
                with uninterrupted():
                    rclpy.spin_once(self._node, timeout_sec=0.1)
                self._check(time.monotonic(), start)
        finally:
            for _ in range(_STOPS):
                self._commands.publish(STOP, max(self._stamp, 0.0))
                time.sleep(0.02)

    def _check(self, now: float, start: float) -> None:
        self._commands.adapt()
        if not self._commands.connected and (mismatch := self._commands.mismatch()):
            raise DriveError(mismatch)
        if self._received is None and now - start > _START_TIMEOUT:
            cause = self._diagnosis.cause("odom", _START_TIMEOUT)
            raise DriveError(
                f"odom: expected a message within {_START_TIMEOUT:g} s, got none; {cause}"
            )
        if self._received is not None and now - self._received > _ODOM_TIMEOUT:
            cause = self._diagnosis.cause("odom", _ODOM_TIMEOUT)
            raise DriveError(f"odom: expected a newer message every {_ODOM_TIMEOUT:g} s; {cause}")
        if self._node.count_publishers("cmd_vel") > 1:
            raise DriveError(
                "cmd_vel: expected no other publisher; stop the executor and other controllers"
            )

    def _take_robot(self, stamp: float, robot: RobotState) -> None:
        if stamp <= self._stamp or self._done:
            return
        self._stamp = stamp
        self._received = time.monotonic()
        try:
            command = self._drive.command(stamp, robot)
        except DriveError as error:
            causes = filter(None, (str(error), self._commands.cause()))
            raise DriveError("; ".join(causes)) from error
        self._done = command is None
        self._commands.publish(command or STOP, stamp)


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
        "--space", type=number(_LEAST, _MOST), default=3.0,
        help="free space ahead of the robot in m (default: %(default)s)",
    )  # fmt: skip
    for axis, unit in (("v", "m/s"), ("w", "rad/s")):
        parser.add_argument(
            f"--{axis}", type=number(_LEAST, _MOST),
            help=f"greatest command in {unit} (default: 1.5 times the limit of --robot)",
        )  # fmt: skip
    parser.add_argument(
        "--stamped", choices=("auto", "true", "false"), default="auto",
        help="whether cmd_vel is a TwistStamped; auto: what the base subscribes to "
        "(default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--frame", type=plain_frame, default="odom",
        help="frame of the odometry (default: %(default)s)",
    )  # fmt: skip
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    options = arguments().parse_args(without_ros_arguments(words)[0])
    return guarded("calibrate", lambda: calibrate(options, words))
