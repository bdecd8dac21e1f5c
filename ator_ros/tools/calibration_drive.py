"""The ROS side of `calibrate`: drives a base over cmd_vel and odom."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence

import rclpy
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from ator_ros.nodes.commands import CommandPublisher
from ator_ros.nodes.diagnosis import Diagnosis
from ator_ros.nodes.inputs import Input, TfListener
from ator_ros.nodes.network import stay_on_this_machine
from ator_ros.nodes.qos import SENSOR_DATA
from ator_ros.robot.probe_drive import DriveError, DriveSample, ProbeDrive
from ator_ros.world.messages import FrameError, OdometryReader
from ator_ros.world.state import STOP

_SILENCE = 2.0  # real s without odometry after which the drive is aborted
_FIRST = 5.0  # real s to wait for odometry
_STOPS = 10  # commands to stop at the end, in case some are lost


def drive_over_ros(drive: ProbeDrive, words: Sequence[str], *, stamped: str, frame: str) -> list[DriveSample]:
    """Drive the base that subscribes to cmd_vel, and stop it whatever happens.

    Parameters
    ----------
    words : sequence of str
        The command line, with arguments for ROS.
    stamped : str
        See `CommandPublisher`.

    Raises
    ------
    DriveError
        Odometry is missing or malformed, another program commands the base, or it does not move.
    """
    stay_on_this_machine(os.environ)
    # rclpy's own handlers would invalidate the context before the robot has been stopped.
    rclpy.init(args=["calibrate", *words], signal_handler_options=SignalHandlerOptions.NO)
    node = Node("calibrate")
    try:
        _Driver(node, drive, stamped=stamped, frame=frame).run()
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    return drive.samples


class _Driver:
    """Answers each odometry message with the command of the drive."""

    def __init__(self, node: Node, drive: ProbeDrive, *, stamped: str, frame: str) -> None:
        self._node, self._drive, self._reader = node, drive, OdometryReader(frame)
        self._commands = CommandPublisher(node, stamped=stamped, frame="base_link", option="--stamped ")
        self._received: float | None = None  # real s
        self._diagnosis = Diagnosis(node, {"odom": Input("odom", Odometry, SENSOR_DATA)}, TfListener(node))
        self._stamp = -1.0
        self._done = False
        node.create_subscription(Odometry, "odom", self._on_odometry, SENSOR_DATA)

    def run(self) -> None:
        """Drive to the end.

        Raises
        ------
        DriveError
            Odometry is missing or malformed, another program commands the base, or it does not move.
        """
        began = time.monotonic()
        try:
            while not self._done:
                rclpy.spin_once(self._node, timeout_sec=0.1)
                self._check(time.monotonic(), began)
        finally:
            for _ in range(_STOPS):
                self._commands.publish(STOP, max(self._stamp, 0.0))
                time.sleep(0.02)

    def _check(self, now: float, began: float) -> None:
        self._commands.adapt()
        if not self._commands.connected and (mismatch := self._commands.mismatch()):
            raise DriveError(mismatch)
        if self._received is None and now - began > _FIRST:
            raise DriveError(f"odom: expected a message within {_FIRST:g} s, got none; {self._cause()}")
        if self._received is not None and now - self._received > _SILENCE:
            raise DriveError(f"odom: expected a newer message every {_SILENCE:g} s; {self._cause()}")
        if self._node.count_publishers("cmd_vel") > 1:
            raise DriveError("cmd_vel: expected no other publisher; end the executor and what else drives")

    def _cause(self) -> str:
        return self._diagnosis.cause("odom", _FIRST)

    def _on_odometry(self, message: Odometry) -> None:
        try:
            stamp, robot = self._reader.read(message)
        except FrameError as error:
            raise DriveError(f"{error}; --frame sets what is expected") from error
        now = time.monotonic()
        self._diagnosis.receptions["odom"].read(stamp, now)
        if self._reader.remark:
            self._node.get_logger().warning(self._reader.remark)
        if stamp <= self._stamp or self._done:
            return
        self._stamp, self._received = stamp, now
        try:
            command = self._drive.command(stamp, robot)
        except DriveError as error:
            raise DriveError("; ".join(filter(None, (str(error), self._commands.cause())))) from error
        self._done = command is None
        self._commands.publish(command or STOP, stamp)
