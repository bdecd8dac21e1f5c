"""Subscriptions to the robot's state: odometry or tf."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from nav_msgs.msg import Odometry
from rclpy.node import Node

from ator_ros.nodes.diagnosis import Input
from ator_ros.nodes.parameters import Parameter, SetupError
from ator_ros.nodes.qos import SENSOR_DATA
from ator_ros.nodes.tf_listener import Found, TfListener
from ator_ros.robot.description import Robot
from ator_ros.world.estimation import RobotVelocity
from ator_ros.world.messages import MessageError, OdometryReader, robot_from_placement
from ator_ros.world.state import RobotState

STATE = Parameter(
    "robot_from", "odom", "where the robot's state comes from: odom, or tf", choices=("odom", "tf")
)


class RobotSource:
    """Subscribes to the robot's state.

    Parameters
    ----------
    node : Node
        The node that subscribes.
    settings : mapping
        The parameters `STATE`, `frame` and `robot_frame`.
    robot : Robot
        Its limits, for velocities that are estimated from tf.
    take : callable
        Is given time in s and state of the robot for each message.
    reject : callable
        Is given "odom" and the error of a message that cannot be used.
    warn : callable
        Is given what is doubtful about messages that are used.
    tf : TfListener
        Looks up the robot in tf.

    Attributes
    ----------
    input : Input
        Where the state comes from.
    """

    def __init__(
        self,
        node: Node,
        settings: Mapping[str, Any],
        robot: Robot,
        take: Callable[[float, RobotState], None],
        reject: Callable[[str, MessageError], None],
        warn: Callable[[str], None],
        tf: TfListener,
    ) -> None:
        self._take, self._reject, self._warn = take, reject, warn
        self._tf, self._frames = tf, (settings["frame"], settings["robot_frame"])
        self._from_tf = settings[STATE.name] == "tf"
        if self._from_tf and len(set(self._frames)) < 2:
            raise SetupError(
                f"parameter robot_frame: expected another frame than frame, got {self._frames[1]}"
            )
        self.input = Input.of_tf(*self._frames) if self._from_tf else Input("odom", Odometry)
        self._velocity = RobotVelocity(robot.limits.v, robot.limits.w)
        self._reader = OdometryReader(settings["frame"])
        if self._from_tf:
            tf.follow(*self._frames, self._take_found)
        else:
            node.create_subscription(Odometry, "odom", self._take_odometry, SENSOR_DATA)

    def _take_odometry(self, message: Odometry) -> None:
        try:
            time, robot = self._reader.read(message)
        except MessageError as error:
            self._reject("odom", error)
            return
        if self._reader.remark:
            self._warn(self._reader.remark)
        self._take(time, robot)

    def _take_found(self, found: Found) -> None:
        try:
            robot = robot_from_placement(found.time, found.placement, self._velocity)
        except MessageError as error:
            self._reject("odom", error)
            return
        self._take(found.time, robot)

    def missing(self) -> str:
        """Return the problem while there is no usable state."""
        return "tf is missing" if self._from_tf else "odom is missing"
