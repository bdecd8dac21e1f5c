"""Velocity commands to the base, as Twist or TwistStamped."""

from __future__ import annotations

from geometry_msgs.msg import Twist, TwistStamped
from rclpy.node import Node

from ator_ros.nodes.conversions import stamp_of, twist_of
from ator_ros.nodes.qos import COMMANDS
from ator_ros.world.state import Command


class CommandPublisher:
    """Publishes on cmd_vel.

    Parameters
    ----------
    node : Node
        The node that publishes.
    stamped : bool
        Whether the messages are geometry_msgs/TwistStamped instead of Twist.
    frame : str
        The robot's own frame, for stamped ones.
    """

    def __init__(self, node: Node, *, stamped: bool, frame: str) -> None:
        self._stamped, self._frame = stamped, frame
        self._publisher = node.create_publisher(TwistStamped if stamped else Twist, "cmd_vel", COMMANDS)

    def publish(self, command: Command, time: float) -> None:
        """Publish a command, with odometry's `time` (s) as its stamp if it has one."""
        twist = twist_of(command)
        if not self._stamped:
            self._publisher.publish(twist)
            return
        message = TwistStamped(twist=twist)
        message.header.stamp, message.header.frame_id = stamp_of(time), self._frame
        self._publisher.publish(message)
