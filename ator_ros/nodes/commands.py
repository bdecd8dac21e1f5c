"""Velocity commands to the base, as Twist or TwistStamped."""

from __future__ import annotations

import time
from typing import Any

from geometry_msgs.msg import Twist, TwistStamped
from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo

from ator_ros.nodes.diagnostics import incompatibility, node_of, type_name, unconnected
from ator_ros.nodes.messages import stamp_of, twist_of
from ator_ros.nodes.qos import NEWEST
from ator_ros.world.state import STOP, Command

_TOPIC = "cmd_vel"
_ODOMETRY = "odom"


class CommandPublisher:
    """Publishes on cmd_vel.

    Parameters
    ----------
    stamped : str
        "true": geometry_msgs/TwistStamped; "false": Twist; "auto": the type that the base
        subscribes to, and Twist without a base. The base is the node that publishes odometry; if
        that does not subscribe, any subscriber may be the base, and the type is kept while one
        takes it. `adapt` has to be called periodically while the robot is commanded to stand.
    frame : str
        The robot's own frame, for stamped commands.

    `changed` is the real time in s at which the type was last chosen; DDS then has to connect the
    base.
    """

    def __init__(self, node: Node, *, stamped: str, frame: str) -> None:
        self._node = node
        self._setting = stamped
        self._frame = frame
        self._last = STOP
        self._use(stamped == "true")

    def _use(self, stamped: bool) -> None:
        self._stamped = stamped
        self.changed = time.monotonic()
        self._publisher = self._node.create_publisher(self.kind, _TOPIC, NEWEST)

    @property
    def kind(self) -> Any:
        """The type of the messages."""
        return TwistStamped if self._stamped else Twist

    @property
    def connected(self) -> bool:
        """Whether any subscription receives the commands."""
        return bool(self._publisher.get_subscription_count() > 0)

    def publish(self, command: Command, stamp: float) -> None:
        """Publish a command; a stamped one has the `stamp` (s) of odometry."""
        self._last = command
        message: Any = twist_of(command)
        if self._stamped:
            message = TwistStamped(twist=message)
            message.header.stamp = stamp_of(stamp)
            message.header.frame_id = self._frame
        self._publisher.publish(message)

    def adapt(self) -> None:
        """Switch to the other type if all bases subscribe to that one and "auto" is set.

        The last command must be to stand: a base that drives may be missing in the graph for a
        moment, while a viewer is listed.
        """
        if self._setting != "auto" or self._last != STOP:
            return
        other = Twist if self._stamped else TwistStamped
        if {info.topic_type for info in self._bases()} == {type_name(other)}:
            self._node.destroy_publisher(self._publisher)
            self._use(not self._stamped)

    def mismatch(self) -> str:
        """Return which base subscribes to another type, and the remedy.

        Empty if a base takes the published type: the others may be viewers.
        """
        bases = self._bases()
        own = type_name(self.kind)
        if not bases or any(info.topic_type == own for info in bases):
            return ""
        return f"{_TOPIC}: the base {self._described(bases[0])}"

    def _described(self, info: TopicEndpointInfo) -> str:
        """Return a sentence on a subscription to a type that is not published, and the remedy."""
        kind = info.topic_type
        text = (
            f"{node_of(info)} subscribes to {kind.replace('/msg/', '/')}, "
            f"this node publishes {self.kind.__name__}"
        )
        if kind not in (type_name(Twist), type_name(TwistStamped)):
            return f"{text}; expected a base that subscribes to Twist or TwistStamped"
        other = "false" if self._stamped else "true"
        return f"{text}; set stamped_commands:={other} (of calibrate: --stamped {other})"

    def cause(self) -> str:
        """Return the most likely cause of a base that does not move.

        Without one, return which nodes receive the commands.
        """
        node = self._node
        if mismatch := self.mismatch():
            return mismatch
        own_type = type_name(self.kind)
        receivers = [info for info in self._subscriptions() if info.topic_type == own_type]
        others = [info for info in self._bases() if info.topic_type != own_type]
        if not receivers:
            return unconnected(node, _TOPIC, self.kind)
        publishers = {node_of(info): info for info in node.get_publishers_info_by_topic(_TOPIC)}
        own = publishers.pop(node.get_fully_qualified_name(), None)
        for info in receivers:
            if own is not None and (reason := incompatibility(own.qos_profile, info.qos_profile)):
                return f"{_TOPIC}: the quality of service of {node_of(info)} does not fit: {reason}"
        if publishers:
            return f"{_TOPIC}: {', '.join(sorted(publishers))} publishes commands as well"
        names = ", ".join(sorted({node_of(info) for info in receivers}))
        if others:
            return f"{_TOPIC} is received by {names}; if {node_of(others[0])} is the base: " + (
                self._described(others[0])
            )
        return f"{_TOPIC} is received only by {names}"

    def _bases(self) -> list[TopicEndpointInfo]:
        """Return the subscriptions of the node that publishes odometry; if it has none, all."""
        subscriptions = self._subscriptions()
        if len({info.topic_type for info in subscriptions}) < 2:
            return subscriptions
        senders = {node_of(info) for info in self._node.get_publishers_info_by_topic(_ODOMETRY)}
        return [info for info in subscriptions if node_of(info) in senders] or subscriptions

    def _subscriptions(self) -> list[TopicEndpointInfo]:
        """Return the subscriptions to cmd_vel, except those of programs that record or print it."""
        infos = self._node.get_subscriptions_info_by_topic(_TOPIC)
        return [
            info
            for info in infos
            if not info.node_name.startswith(("_ros2cli", "rosbag2_recorder"))
        ]
