"""The health of a node on /diagnostics, and the causes of missing inputs."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.topic_endpoint_info import TopicEndpointInfo

from ator_ros.nodes.qos import RESULTS
from ator_ros.nodes.subscriptions import GAPS, MOST_NAMED, WARNING_PERIOD, Subscriptions
from ator_ros.printable import listed, one_line, printable
from ator_ros.world.readers import FrameError, SendersError, second_parent

STEADY = Clock(clock_type=ClockType.STEADY_TIME)  # of timers that are independent of simulated time
_PERIOD = 1.0  # s, as usual for /diagnostics
# reports in a row after which a problem is logged: inputs are also missing at the start
_PERSISTENT = 5
_LONGEST = 500  # characters of a status, which may join the messages of several problems
_UNKNOWN = "(unknown)"
_PROCESS = 12  # bytes at the begin of an identity of DDS that a process has in common
_TICKS = 1000  # newest ticks that count: 50 s at 20 a second


@dataclass(frozen=True, slots=True)
class Health:
    """A node's health.

    `problem` is empty for a healthy node; an `error` is a problem that keeps it from working.
    """

    problem: str = ""
    error: bool = False
    values: Mapping[str, object] = field(default_factory=dict)


class Diagnostics:
    """Publishes a node's health on /diagnostics once a second, and logs lasting problems.

    `topics` are the types of the topics that the node subscribes to, by name: publishers of other
    types are reported.
    """

    def __init__(
        self, node: Node, health: Callable[[], Health], topics: Mapping[str, type] | None = None
    ) -> None:
        self._node = node
        self._health = health
        self._topics = topics or {}
        self._problem = ""
        self._repeats = 0
        self._logged = ""
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", RESULTS)
        node.create_timer(_PERIOD, self._publish, clock=STEADY)

    def _publish(self) -> None:
        health = self._health()
        mismatches = (type_mismatch(self._node, *topic) for topic in self._topics.items())
        others = (text for text in mismatches if text not in health.problem)
        problem = "; ".join(filter(None, (health.problem, *others)))
        self._repeats = self._repeats + 1 if problem == self._problem else 1
        self._problem = problem
        if problem != self._logged and self._repeats >= (_PERSISTENT if problem else 1):
            if problem:
                self._node.get_logger().warning(one_line(problem, _LONGEST))
            self._logged = problem
        level = DiagnosticStatus.OK
        if problem:
            level = DiagnosticStatus.ERROR if health.error else DiagnosticStatus.WARN
        status = DiagnosticStatus(
            level=level,
            name=self._node.get_fully_qualified_name(),
            message=one_line(problem or "running", _LONGEST),
            values=[
                KeyValue(key=key, value=one_line(value)) for key, value in health.values.items()
            ],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)


class Warnings:
    """Logs warnings, each in one line, at most one in `WARNING_PERIOD`.

    `last` is the text of the last one.
    """

    def __init__(self, node: Node) -> None:
        self._logger = node.get_logger()
        self.last = ""

    def __call__(self, text: str) -> None:
        """Log a warning."""
        self.last = text
        self._logger.warning(one_line(text), throttle_duration_sec=WARNING_PERIOD)


class Ticks:
    """Intervals and durations of the last thousand ticks, in real s."""

    def __init__(self) -> None:
        self._last = math.inf
        self._gaps = deque([0.0], maxlen=_TICKS)
        self._durations = deque([0.0], maxlen=_TICKS)

    def start(self, now: float) -> None:
        """Record a tick that starts at `now` s."""
        self._gaps.append(max(0.0, now - self._last))
        self._last = now

    def end(self, now: float) -> None:
        """Record that the tick ends at `now` s."""
        self._durations.append(now - self._last)

    def diagnostics(self) -> dict[str, object]:
        """Return values for /diagnostics."""
        within = np.quantile(self._durations, 0.99)
        return {
            "longest time between ticks (ms)": f"{1000.0 * max(self._gaps):.1f}",
            "longest tick (ms)": f"{1000.0 * max(self._durations):.1f}",
            f"99 % of the last {_TICKS} ticks within (ms)": f"{1000.0 * within:.1f}",
        }


class Diagnosis:
    """Returns the most likely causes of missing inputs of a node; "odom" is the robot."""

    def __init__(self, node: Node, subscribed: Subscriptions) -> None:
        self._node = node
        self._tf = subscribed.tf
        self._inputs = subscribed.inputs

    @property
    def topics(self) -> dict[str, Any]:
        """The types of the subscribed topics except tf."""
        return {item.topic: item.kind for item in self._inputs.values() if item.frames is None}

    def rate_problem(self, name: str, timeout: float) -> str:
        """Return the remedy if messages of an input are too rare for its `timeout` in real s.

        Else "".
        """
        gaps = self._inputs[name].gaps
        topic = self._inputs[name].topic
        if len(gaps) < GAPS or (usual := float(np.median(gaps))) <= 0.5 * timeout:
            return ""
        needed = math.ceil(40.0 * usual) / 10.0
        return (
            f"{topic}: messages came {usual:.2f} s apart, too rarely for a timeout of {timeout:g} "
            f"s: the robot pauses between them; set {name}_timeout:={needed:.1f}"
        )

    def senders_problem(self) -> str:
        """Return that an input has several senders, or a frame of it in tf two parents; else ""."""
        frames = [item.frames for item in self._inputs.values() if item.frames is not None]
        parents = (second_parent(self._tf.transforms, *pair) for pair in frames)
        several = several_publishers(self._node, self.topics)
        return "; ".join(filter(None, (several, *dict.fromkeys(parents))))

    def cause(self, name: str, timeout: float) -> str:
        """Return why an input is missing; `timeout` is its longest allowed gap in real s."""
        item = self._inputs[name]
        node = self._node
        topic = item.topic
        kind = item.kind
        if item.frames is not None and item.error is None and node.count_publishers(topic):
            return self._tf.problem(*item.frames)
        infos = node.get_publishers_info_by_topic(topic)
        senders = [info for info in infos if info.topic_type == type_name(kind)]
        if not senders:
            return type_mismatch(node, topic, kind) or unconnected(
                node, topic, kind, tuple(self.topics)
            )
        sender = node_of(senders[0])
        if isinstance(item.error, SendersError):
            sender = listed(sorted({node_of(info) for info in senders}), MOST_NAMED)
        reasons = [incompatibility(info.qos_profile, item.qos) for info in senders]
        if all(reasons):
            return f"{topic}: the quality of service of {sender} does not fit: {reasons[0]}"
        if item.error is not None:
            advice = ""
            if isinstance(item.error, FrameError) and topic == "odom":
                advice = f"; set frame:={item.error.got} (of calibrate: --frame {item.error.got})"
            return f"messages of {sender} are ignored: {item.error}{advice}"
        if math.isinf(item.last):
            return f"{topic}: {sender} publishes it, but sends no messages"
        if item.last > item.advanced:
            return (
                f"{topic}: the stamps of {sender} stay at {item.stamp:.2f} s: expected stamps that "
                "advance; is the simulation paused, or does the driver not set them?"
            )
        paused = f"{topic}: {sender} sends no more messages: it is paused, blocked or has ended"
        return self.rate_problem(name, timeout) or paused


def unconnected(node: Node, topic: str, kind: type, known: Collection[str] | None = None) -> str:
    """Return that no other node publishes, or subscribes to, a topic, and the remedy.

    `known` are topics that the node subscribes to; None if it publishes.
    """
    does = "publishes"
    count = node.count_publishers
    if known is None:
        does = "subscribes to"
        count = node.count_subscribers
    resolved = node.resolve_topic_name(topic)
    domain = node.context.get_domain_id()
    skipped = {resolved, *map(node.resolve_topic_name, known or ())}
    elsewhere = [
        other
        for other, types in node.get_topic_names_and_types()
        if type_name(kind) in types and other not in skipped and count(other)
    ]
    text = f"no node {does} {resolved} in ROS domain {domain}"
    short = _short(type_name(kind))
    if not elsewhere:
        return f"{text}, and there is no other topic of type {short}: start the node that {does} it"
    remedy = f"remap with -r {topic}:={elsewhere[0]}"
    return f"{text}; of type {short} there is {', '.join(elsewhere)}: {remedy}"


def incompatibility(offered: QoSProfile, requested: QoSProfile) -> str:
    """Return why a subscription does not receive from a publisher; empty if it does."""
    verdict, reason = qos_check_compatible(offered, requested)
    if verdict != QoSCompatibility.ERROR:
        return ""
    return printable(reason.partition(";")[0].removeprefix("ERROR:").strip())


def node_of(info: TopicEndpointInfo) -> str:
    """Return the full name of the node of a publisher or subscription."""
    if "_UNKNOWN_" in info.node_name:  # DDS announces endpoints before the names of their nodes
        return _UNKNOWN
    return f"{printable(info.node_namespace.rstrip('/'))}/{printable(info.node_name)}"


def type_name(kind: type) -> str:
    """Return the name of a message type, such as nav_msgs/msg/Odometry."""
    package, folder, *_ = kind.__module__.split(".")
    return f"{package}/{folder}/{kind.__name__}"


def _short(name: str) -> str:
    return printable(name.replace("/msg/", "/"))


def type_mismatch(node: Node, topic: str, kind: type) -> str:
    """Return which node publishes another type than `node` subscribes to, which ROS drops."""
    for info in node.get_publishers_info_by_topic(topic):
        if info.topic_type != type_name(kind):
            expected = _short(type_name(kind))
            got = _short(info.topic_type)
            return f"{topic}: expected {expected}, {node_of(info)} publishes {got}"
    return ""


def several_publishers(node: Node, topics: Iterable[str]) -> str:
    """Return the topics with several publishers; empty if there are none.

    DDS lists killed publishers for 20 s.
    """
    senders = {topic: _senders(node.get_publishers_info_by_topic(topic)) for topic in topics}
    return "; ".join(
        f"{topic}: expected one publisher, got {len(names)}: {', '.join(sorted(names))}"
        for topic, names in senders.items()
        if len(names) > 1
    )


def _senders(infos: Iterable[TopicEndpointInfo]) -> list[str]:
    """Return the name of each publisher's node.

    Of several processes with a node of one name, only one counts: the others may have been killed.
    """
    processes: dict[str, Counter[bytes]] = {}
    for info in infos:
        if (name := node_of(info)) != _UNKNOWN:
            process = bytes(info.endpoint_gid[:_PROCESS])
            processes.setdefault(name, Counter())[process] += 1
    return [name for name, counts in processes.items() for _ in range(max(counts.values()))]
