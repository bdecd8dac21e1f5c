"""Where the robot's state comes from: odometry or tf."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from geometry_msgs.msg import Quaternion
from nav_msgs.msg import Odometry
from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node

from ator_ros.geometry import Pose
from ator_ros.nodes import checks, conversions
from ator_ros.nodes.checks import MessageBounds, bounds_of
from ator_ros.nodes.parameters import Parameter, SetupError
from ator_ros.nodes.qos import SENSOR_DATA
from ator_ros.nodes.tf_listener import Found, TfListener
from ator_ros.robot.description import Robot
from ator_ros.world.state import RobotState
from ator_ros.world.velocity import RobotVelocity

STATE = Parameter(
    "robot_from", "odom", "where the robot's state comes from: odom, or tf", choices=("odom", "tf")
)
Read = Callable[[], tuple[float, RobotState]]
"""Returns time in s and state of the robot; raises MessageError."""


class RobotSource:
    """Listens to the robot's state.

    Parameters
    ----------
    node : Node
        Who listens.
    settings : mapping
        The parameters `STATE`, `frame` and `robot_frame`.
    robot : Robot
        Its limits.
    take : callable
        Is given what reads a message that has come.
    tf : TfListener
        Looks up the robot in tf.
    group : CallbackGroup, optional
        Of the subscription to odometry.

    Attributes
    ----------
    topics : dict of str to type
        The type of the messages by the name of the topic, tf excepted.
    """

    def __init__(
        self,
        node: Node,
        settings: Mapping[str, Any],
        robot: Robot,
        take: Callable[[Read], None],
        tf: TfListener,
        group: CallbackGroup | None = None,
    ) -> None:
        self._tf, self._frames = tf, (settings["frame"], settings["robot_frame"])
        self._from_tf = settings[STATE.name] == "tf"
        if self._from_tf and len(set(self._frames)) < 2:
            raise SetupError(
                f"parameter robot_frame: expected another frame than frame, got {self._frames[1]}"
            )
        self.topics: dict[str, type] = {} if self._from_tf else {"odom": Odometry}
        bounds, frame = bounds_of(robot), settings["frame"]
        if self._from_tf:
            estimate = RobotVelocity(robot.limits.v, robot.limits.w)
            tf.follow(*self._frames, lambda found: take(partial(robot_in_tf, found, estimate, bounds)))
            return
        read = partial(conversions.robot_from, frame=frame, bounds=bounds)

        def hear(message: Odometry) -> None:
            take(partial(read, message))

        node.create_subscription(Odometry, "odom", hear, SENSOR_DATA, callback_group=group)

    def missing(self) -> str:
        """Return what is said where no state has come."""
        if not self._from_tf:
            return "odom is missing"
        frame, child = self._frames
        known = self._tf.connects(frame, child)
        return f"tf is {'old' if known else 'missing'}: expected transforms from {frame} to {child}"


def robot_in_tf(found: Found, estimate: RobotVelocity, bounds: MessageBounds) -> tuple[float, RobotState]:
    """Read the robot's state from tf; its velocities are differences. Raises MessageError."""
    (x, y, _), (i, j, k, w) = found.placement
    pose = Pose(
        checks.position(x, "robot in tf: x", most=bounds.x),
        checks.position(y, "robot in tf: y", most=bounds.y),
        checks.planar_yaw(Quaternion(x=i, y=j, z=k, w=w), "robot in tf: rotation"),
    )
    state = estimate.state(found.time, pose)
    checks.velocity(state.v, "robot in tf: v", most=bounds.v)
    checks.velocity(state.w, "robot in tf: w", "rad/s", most=bounds.w)
    return found.time, state
