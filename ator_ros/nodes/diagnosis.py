"""Why inputs do not arrive, or the robot does not move: the likely cause, from messages and the ROS graph."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.topic_endpoint_info import TopicEndpointInfo

from ator_ros.nodes.inputs import Input, TfListener
from ator_ros.printable import printable
from ator_ros.world.messages import FrameError

_MOST_NAMED = 4
_WALL = 1e9
"""s; greater stamps are of a wall clock, which counts from 1970, others of one that counts from a start."""
_REPEATS = 3
"""Messages in a row that repeat a stamp: a message that is sent twice by accident is no reason."""
_GAPS = 5
"""Gaps between messages that must all be long: one or two are messages that were lost or late."""


@dataclass(slots=True)
class Reception:
    """The last messages of one topic.

    `last` is the real time in s of the last message, usable or not; `stamp` that of the last one that could
    be read, which `repeats` later ones had as well. `gaps` are the real s between the last messages with
    different stamps. `error` is why the last message was ignored.
    """

    last: float = -math.inf
    stamp: float = math.nan
    repeats: int = 0
    gaps: deque[float] = field(default_factory=lambda: deque(maxlen=_GAPS))
    error: Exception | None = None
    _advanced: float = math.nan

    def read(self, stamp: float, now: float) -> None:
        """Record a message that could be read, with its stamp in s, at `now` in real s."""
        self.last, self.error = now, None
        if stamp == self.stamp:
            self.repeats += 1
            return
        if now > self._advanced:
            self.gaps.append(now - self._advanced)
        self.stamp, self.repeats, self._advanced = stamp, 0, now

    def reject(self, error: Exception, now: float) -> None:
        """Record a message that was ignored."""
        self.last, self.error = now, error


class Diagnosis:
    """Records which messages a node receives, and names the most likely cause if an input is missing.

    `inputs` are the node's, by name; "odom" is the robot.

    Attributes
    ----------
    receptions : dict of str to Reception
        The last messages of each input, by its name.
    """

    def __init__(self, node: Node, inputs: Mapping[str, Input], tf: TfListener) -> None:
        self._node, self._inputs, self._tf = node, inputs, tf
        self.receptions = {name: Reception() for name in inputs}

    @property
    def topics(self) -> dict[str, Any]:
        """The types of the topics that are subscribed to, tf excepted."""
        return {item.topic: item.kind for item in self._inputs.values() if item.frames is None}

    def rate_problem(self, name: str, timeout: float) -> str:
        """Return that messages of an input come too rarely to drive by, and what to do; else nothing.

        `timeout` is the real s within which messages are expected; after half of it the robot pauses.
        """
        gaps = self.receptions[name].gaps
        if len(gaps) < _GAPS or min(gaps) <= 0.5 * timeout:
            return ""
        text = _too_rare(name, self._inputs[name].topic, min(gaps), timeout)
        return f"{text}: the robot pauses between them"

    def cause(self, name: str, timeout: float) -> str:
        """Return why an input is missing, in one sentence; `timeout` is its longest allowed gap in real s."""
        item, reception, node = self._inputs[name], self.receptions[name], self._node
        topic, kind = item.topic, item.kind
        if item.frames is not None and reception.error is None and node.count_publishers(topic):
            return self._tf.lacking(*item.frames)
        infos = node.get_publishers_info_by_topic(topic)
        senders = [info for info in infos if info.topic_type == type_name(kind)]
        if not senders:
            return type_mismatch(node, topic, kind) or unconnected(node, topic, kind, tuple(self.topics))
        sender = node_of(senders[0])
        reasons = [incompatibility(info.qos_profile, item.qos) for info in senders]
        if all(reasons):
            return f"{topic}: the quality of service of {sender} does not fit: {reasons[0]}"
        if reception.error is not None:
            return _rejected(topic, sender, reception, self.receptions["odom"].stamp)
        if reception.repeats >= _REPEATS:
            return (
                f"{topic}: the stamps of {sender} stay at {reception.stamp:.2f} s: expected stamps that "
                "advance; is the simulation paused, or does the driver not set them?"
            )
        if math.isinf(reception.last):
            return f"{topic}: {sender} publishes it, but sends no messages"
        if reception.gaps and reception.gaps[-1] > 0.5 * timeout:
            return _too_rare(name, topic, reception.gaps[-1], timeout)
        return f"{topic}: {sender} sends no more messages: it is paused, blocked or has ended"


def _too_rare(name: str, topic: str, gap: float, timeout: float) -> str:
    return (
        f"{topic}: messages came {gap:.2f} s apart, too rarely for a timeout of {timeout:g} s; "
        f"set {name}_timeout:={math.ceil(40.0 * gap) / 10.0:.1f}"
    )


def _rejected(topic: str, sender: str, reception: Reception, reference: float) -> str:
    wall = reception.stamp > _WALL
    if math.isfinite(reception.stamp) and math.isfinite(reference) and wall != (reference > _WALL):
        kinds = ("the wall clock", "simulated time") if wall else ("simulated time", "the wall clock")
        text = f"{topic}: {sender} stamps with {kinds[0]}, odometry with {kinds[1]}"
        return f"{text}; set use_sim_time alike for both"
    advice = ""
    if isinstance(reception.error, FrameError):
        advice = f"; set frame:={reception.error.got}" if topic == "odom" else "; expected odometry's frame"
    return f"messages of {sender} are ignored: {reception.error}{advice}"


def bases(node: Node, topic: str) -> list[TopicEndpointInfo]:
    """Return the subscriptions that may be those of a base: not of programs that record or print."""
    infos = node.get_subscriptions_info_by_topic(topic)
    return [info for info in infos if not info.node_name.startswith(("_ros2cli", "rosbag2_recorder"))]


def unconnected(node: Node, topic: str, kind: type, known: Collection[str] | None = None) -> str:
    """Return that no other node publishes, or subscribes to, a topic, and what to do.

    `known` are topics that the node subscribes to; None if it publishes.
    """
    does, count = "publishes", node.count_publishers
    if known is None:
        does, count = "subscribes to", node.count_subscribers
    resolved, domain = node.resolve_topic_name(topic), node.context.get_domain_id()
    skipped = {resolved, *map(node.resolve_topic_name, known or ())}
    elsewhere = [
        other
        for other, types in node.get_topic_names_and_types()
        if type_name(kind) in types and other not in skipped and count(other)
    ]
    text, short = f"no node {does} {resolved} in ROS domain {domain}", _short(type_name(kind))
    if not elsewhere:
        return f"{text}, and there is no other topic of type {short}: start the node that {does} it"
    return f"{text}; of type {short} there is {several(elsewhere)}: remap with -r {topic}:={elsewhere[0]}"


def incompatibility(offered: QoSProfile, requested: QoSProfile) -> str:
    """Return the first reason why a subscription does not receive from a publisher; empty if it does."""
    verdict, reason = qos_check_compatible(offered, requested)
    if verdict != QoSCompatibility.ERROR:
        return ""
    return printable(reason.partition(";")[0].removeprefix("ERROR:").strip())


def node_of(info: TopicEndpointInfo) -> str:
    """Return the full name of the node of a publisher or subscription."""
    if "_UNKNOWN_" in info.node_name:  # DDS announces endpoints before the names of their nodes
        return "(unknown)"
    return f"{printable(info.node_namespace.rstrip('/'))}/{printable(info.node_name)}"


def type_name(kind: type) -> str:
    """Return the name of a message type, such as nav_msgs/msg/Odometry."""
    package, folder, *_ = kind.__module__.split(".")
    return f"{package}/{folder}/{kind.__name__}"


def _short(name: str) -> str:
    return printable(name.replace("/msg/", "/"))


def several(names: Collection[str]) -> str:
    """Return the first names as text, and how many more there are."""
    more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    return ", ".join(list(names)[:_MOST_NAMED]) + more


def type_mismatch(node: Node, topic: str, kind: type) -> str:
    """Return which node publishes another type than `node` subscribes to; ROS drops such messages."""
    for info in node.get_publishers_info_by_topic(topic):
        if info.topic_type != type_name(kind):
            expected, got = _short(type_name(kind)), _short(info.topic_type)
            return f"{topic}: expected {expected}, {node_of(info)} publishes {got}"
    return ""


def rival_senders(node: Node, topics: Iterable[str]) -> str:
    """Return the topics with several publishers, which DDS counts for 20 s after they were killed."""
    senders = {topic: [node_of(s) for s in node.get_publishers_info_by_topic(topic)] for topic in topics}
    return "; ".join(
        f"{topic}: expected one publisher, got {len(names)}: {several(sorted(names))}"
        for topic, names in senders.items()
        if len(names) > 1
    )
