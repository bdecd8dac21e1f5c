"""Why inputs do not arrive, or the robot does not move: facts of the ROS graph, and their likely cause."""

from __future__ import annotations

import copy
import math
import time
from collections import deque
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from rclpy.duration import Infinite
from rclpy.node import Node
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rosgraph_msgs.msg import Clock

from ator_ros.nodes.inputs import Input, TfListener
from ator_ros.nodes.qos import RESULTS, SENSOR_DATA
from ator_ros.printable import printable
from ator_ros.world.messages import FrameError

_MOST_NAMED = 4
_WALL = 1e9
"""s; greater stamps are of a wall clock, which counts from 1970, others of one that counts from a start."""
_REPEATS = 3
"""Messages in a row that repeat a stamp: a message that is sent twice by accident is no reason."""
_SAMPLE, _PAUSE = 1.0, 4.0
"""Real s for which /clock is subscribed to while odometry is missing, and between two such samples."""
_GAPS = 5
"""Gaps between messages that must all be long: one or two are messages that were lost or late."""
_RAREST = 0.12
"""Stamped s between two messages of odometry: from 10 Hz on, with jitter, actions drive as at 20 Hz."""
_SHORTEST_SAMPLE = 0.1
"""Real s after which a clock counts as standing; simulators publish it at 100 Hz or more."""


# Facts


@dataclass(frozen=True, slots=True)
class Endpoint:
    """A publisher or subscription of another node.

    Attributes
    ----------
    node : str
        Full name of the node.
    type : str
        Type of the messages, such as nav_msgs/msg/Odometry.
    incompatible : str
        Why its quality of service does not fit ours; empty if it does.
    pauses : bool
        Whether the node has a service `pause`.
    """

    node: str
    type: str
    incompatible: str = ""
    pauses: bool = False


@dataclass(frozen=True, slots=True)
class TopicFacts:
    """What the ROS graph shows of a topic.

    Attributes
    ----------
    name : str
        The name that the node uses, before remapping.
    resolved : str
        The full name.
    type : str
        The type that the node subscribes to or publishes.
    others : tuple of Endpoint
        The publishers if the node subscribes, the subscriptions if it publishes.
    elsewhere : tuple of str
        Other topics with such endpoints of this type.
    domain : int
        The ROS domain.
    """

    name: str
    resolved: str
    type: str
    others: tuple[Endpoint, ...] = ()
    elsewhere: tuple[str, ...] = ()
    domain: int = 0


@dataclass(slots=True)
class Reception:
    """The last messages of one topic.

    Attributes
    ----------
    last : float
        Real time in s of the last message, usable or not; -inf before the first.
    stamp : float
        Stamp in s of the last message that could be read; NaN before the first.
    repeats : int
        Number of later messages with the same stamp.
    gap : float
        Real s between the last two messages with different stamps; 0 before the second.
    gaps : deque of (float, float)
        Real s and stamped s between the last messages with different stamps.
    error : Exception or None
        Why the last message was ignored.
    """

    last: float = -math.inf
    stamp: float = math.nan
    repeats: int = 0
    gap: float = 0.0
    error: Exception | None = None
    gaps: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=_GAPS))
    _advanced: float = math.nan

    def read(self, stamp: float, now: float) -> None:
        """Record a message that could be read."""
        self.last, self.error = now, None
        if stamp == self.stamp:
            self.repeats += 1
            return
        self.gap = 0.0 if math.isnan(self._advanced) else now - self._advanced
        if self.gap:
            self.gaps.append((self.gap, stamp - self.stamp))
        self.stamp, self.repeats, self._advanced = stamp, 0, now

    def reject(self, error: Exception, now: float) -> None:
        """Record a message that was ignored."""
        self.last, self.error = now, error


@dataclass(frozen=True, slots=True)
class ClockFacts:
    """The publishers of /clock, and for how many real s it has not advanced; 0 if it advances."""

    publishers: tuple[str, ...] = ()
    stopped: float = 0.0


class ClockSampler:
    """Subscribes to /clock for a second now and then: some simulators publish it at 1000 Hz."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._subscription: Any = None
        self._began = self._advanced = self._last = math.nan
        self._next = -math.inf
        self._stopped = 0.0

    def sample(self, now: float) -> None:
        """Continue a sample, or begin one if it is time; `now` is real time in s."""
        if self._subscription is None and now >= self._next and self._node.count_publishers("/clock"):
            self._began = self._advanced = now
            self._last = math.nan
            self._subscription = self._node.create_subscription(Clock, "/clock", self._take, SENSOR_DATA)
        elif self._subscription is not None:
            stopped = now - self._advanced
            self._stopped = stopped if stopped >= _SHORTEST_SAMPLE else 0.0
            if now - self._began > _SAMPLE:
                self._stop()
                self._next = now + _PAUSE

    def reset(self) -> None:
        """Stop sampling and forget the result, as odometry arrives."""
        self._stop()
        self._next, self._stopped = -math.inf, 0.0

    def _stop(self) -> None:
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None

    def _take(self, message: Clock) -> None:
        stamp = message.clock.sec + 1e-9 * message.clock.nanosec
        if stamp != self._last:
            self._last, self._advanced = stamp, time.monotonic()

    def facts(self) -> ClockFacts:
        """Return the result of the last sample."""
        infos = self._node.get_publishers_info_by_topic("/clock")
        return ClockFacts(tuple(node_of(info) for info in infos), self._stopped)


def publishers_of(
    node: Node, topic: str, kind: type, qos: QoSProfile = SENSOR_DATA, *, known: Collection[str] = ()
) -> TopicFacts:
    """Gather what the graph shows of a topic that `node` subscribes to with the profile `qos`.

    `known` are other topics that the node subscribes to: they are no candidates for this one.
    """
    infos = node.get_publishers_info_by_topic(topic)
    others = tuple(_endpoint(node, info, _compatibility(info.qos_profile, qos)) for info in infos)
    return _facts(node, topic, kind, others, node.count_publishers, known)


def subscriptions_of(node: Node, topic: str, kind: type, qos: QoSProfile) -> TopicFacts:
    """Gather what the graph shows of a topic that `node` publishes with the profile `qos`.

    Subscriptions of programs that only record or print are left out.
    """
    infos = node.get_subscriptions_info_by_topic(topic)
    others = tuple(
        _endpoint(node, info, _compatibility(qos, info.qos_profile)) for info in infos if is_base(info)
    )
    return _facts(node, topic, kind, others, node.count_subscribers, ())


def _compatibility(offered: QoSProfile, requested: QoSProfile) -> tuple[QoSCompatibility, str]:
    verdict, reason = qos_check_compatible(_with_durations(offered), _with_durations(requested))
    return verdict, reason


def _with_durations(qos: QoSProfile) -> QoSProfile:
    """Return a copy with default durations as the graph shows them: infinite, where profiles have 0."""
    copied = copy.copy(qos)
    for name in ("deadline", "lifespan", "liveliness_lease_duration"):
        if getattr(copied, name).nanoseconds == 0:
            setattr(copied, name, Infinite)
    return copied


def _facts(
    node: Node, topic: str, kind: type, others: tuple[Endpoint, ...], count: Any, known: Collection[str]
) -> TopicFacts:
    resolved, name = node.resolve_topic_name(topic), type_name(kind)
    skipped = {resolved, *map(node.resolve_topic_name, known)}
    elsewhere = tuple(
        other
        for other, types in node.get_topic_names_and_types()
        if name in types and other not in skipped and count(other)
    )
    return TopicFacts(topic, resolved, name, others, elsewhere, node.context.get_domain_id())


def _endpoint(node: Node, info: TopicEndpointInfo, fit: tuple[QoSCompatibility, str]) -> Endpoint:
    verdict, reason = fit
    try:
        services = node.get_service_names_and_types_by_node(info.node_name, info.node_namespace)
    except RuntimeError:  # its name is not known yet, or it has just ended
        services = []
    pauses = any(name.rpartition("/")[2] == "pause" for name, _ in services)
    # rclpy lists all that does not fit as "ERROR: why;ERROR: why;": the first is enough to change.
    first = printable(reason.partition(";")[0].removeprefix("ERROR:").strip())
    wrong = first if verdict == QoSCompatibility.ERROR else ""
    return Endpoint(node_of(info), printable(info.topic_type), wrong, pauses)


def is_base(info: TopicEndpointInfo) -> bool:
    """Return whether a subscription may be that of a base: not one of a program that records or prints."""
    return not info.node_name.startswith(("_ros2cli", "rosbag2_recorder"))


def node_of(info: TopicEndpointInfo) -> str:
    """Return the full name of the node of a publisher or subscription."""
    if "_UNKNOWN_" in info.node_name:  # DDS announces endpoints before the names of their nodes
        return "(unknown)"
    return f"{printable(info.node_namespace.rstrip('/'))}/{printable(info.node_name)}"


def type_name(kind: type) -> str:
    """Return the name of a message type, such as nav_msgs/msg/Odometry."""
    package, folder, *_ = kind.__module__.split(".")
    return f"{package}/{folder}/{kind.__name__}"


# Causes


class Diagnosis:
    """Records which messages a node receives, and names the most likely cause if an input is missing.

    Parameters
    ----------
    node : Node
        The node.
    inputs : mapping of str to Input
        Its inputs by name; "odom" is the robot.
    tf : TfListener
        Its transforms.
    """

    def __init__(self, node: Node, inputs: Mapping[str, Input], tf: TfListener) -> None:
        self._node, self._inputs, self._tf = node, inputs, tf
        self._receptions = {name: Reception() for name in inputs}
        self._clock = ClockSampler(node)

    @property
    def topics(self) -> dict[str, Any]:
        """The types of the topics that are subscribed to, tf excepted."""
        return {item.topic: item.kind for item in self._inputs.values() if item.frames is None}

    def read(self, name: str, stamp: float, now: float) -> None:
        """Record a message of an input with its stamp in s, at `now` in real s."""
        self._receptions[name].read(stamp, now)

    def reject(self, name: str, error: Exception, now: float) -> None:
        """Record a message of an input that was ignored."""
        self._receptions[name].reject(error, now)

    def watch(self, now: float, *, missing: bool) -> None:
        """Observe /clock as long as odometry is `missing`; to be called now and then."""
        if missing:
            self._clock.sample(now)
        else:
            self._clock.reset()

    def rate_problem(self, name: str, timeout: float) -> str:
        """Return that messages of an input come too rarely to drive by; empty if they do not."""
        return rate_problem(self._inputs[name].topic, self._receptions[name], timeout)

    def cause(self, name: str, timeout: float) -> str:
        """Return why an input is missing, in one sentence; `timeout` is its longest allowed gap in real s."""
        item, reception = self._inputs[name], self._receptions[name]
        if item.frames is not None:
            facts = publishers_of(self._node, item.topic, item.kind, RESULTS)
            sent = bool(facts.others) and not all(other.incompatible for other in facts.others)
            if sent and reception.error is None:
                return self._tf.lacking(*item.frames)
        else:
            known = [other.topic for other in self._inputs.values() if other.topic != item.topic]
            facts = publishers_of(self._node, item.topic, item.kind, known=known)
        reference = self._receptions["odom"].stamp if name != "odom" else math.nan
        return input_cause(facts, reception, self._clock.facts(), timeout=timeout, reference=reference)


def input_cause(
    topic: TopicFacts, reception: Reception, clock: ClockFacts, *, timeout: float, reference: float = math.nan
) -> str:
    """Return the most likely cause why no usable messages arrive on a topic, in one sentence.

    Parameters
    ----------
    topic : TopicFacts
        The topic.
    reception : Reception
        Its messages.
    clock : ClockFacts
        What is known of /clock.
    timeout : float
        Real s within which messages are expected.
    reference : float
        Last stamp of odometry in s, with which the stamps of objects are compared.
    """
    name = topic.name
    senders = [other for other in topic.others if other.type == topic.type]
    if not senders:
        return _no_sender(topic)
    node = senders[0].node
    if all(sender.incompatible for sender in senders):
        return f"{name}: the quality of service of {node} does not fit: {senders[0].incompatible}"
    if reception.error is not None:
        return _rejected(name, node, reception, reference)
    if reception.repeats >= _REPEATS:
        return _repeated(name, senders[0], reception, clock)
    if clock.stopped:
        return f"{_clock(clock)}: the simulation is paused or has ended"
    if math.isinf(reception.last):
        return f"{name}: {node} publishes it, but sends no messages"
    if reception.gap > 0.5 * timeout:
        return _too_rare(name, reception.gap, timeout)
    return f"{name}: {node} sends no more messages: it is paused, blocked or has ended"


def rate_problem(name: str, reception: Reception, timeout: float) -> str:
    """Return that messages come too rarely to drive by, and what to do; empty if they do not.

    Parameters
    ----------
    name : str
        The topic.
    reception : Reception
        Its messages.
    timeout : float
        Real s within which messages are expected; after half of it the robot pauses.
    """
    if len(reception.gaps) < _GAPS:
        return ""
    gap, stamped = (min(values) for values in zip(*reception.gaps, strict=True))
    if gap > 0.5 * timeout:
        return f"{_too_rare(name, gap, timeout)}: the robot pauses between them"
    if stamped > _RAREST:
        return (
            f"{name}: messages come {stamped:.2f} s apart by their stamps; expected 10 or more in a second; "
            "raise the rate of the base's driver"
        )
    return ""


def _too_rare(name: str, gap: float, timeout: float) -> str:
    return (
        f"{name}: messages came {gap:.2f} s apart, too rarely for a timeout of {timeout:g} s; "
        f"set {name}_timeout:={math.ceil(40.0 * gap) / 10.0:.1f}"
    )


def _no_sender(topic: TopicFacts) -> str:
    if topic.others:
        other = topic.others[0]
        return f"{topic.name}: expected {_short(topic.type)}, {other.node} publishes {_short(other.type)}"
    return _unconnected(topic, "publishes")


def _unconnected(topic: TopicFacts, does: str) -> str:
    """Return that no other node publishes, or subscribes to, a topic, and what to do."""
    text = f"no node {does} {topic.resolved} in ROS domain {topic.domain}"
    if not topic.elsewhere:
        return f"{text}, and there is no other topic of type {_short(topic.type)}: start the base's driver"
    first = topic.elsewhere[0]
    names = _several(topic.elsewhere)
    return f"{text}; of type {_short(topic.type)} there is {names}: remap with -r {topic.name}:={first}"


def _rejected(name: str, node: str, reception: Reception, reference: float) -> str:
    wall = reception.stamp > _WALL
    if math.isfinite(reception.stamp) and math.isfinite(reference) and wall != (reference > _WALL):
        kinds = ("the wall clock", "simulated time") if wall else ("simulated time", "the wall clock")
        text = f"{name}: {node} stamps with {kinds[0]}, odometry with {kinds[1]}"
        return f"{text}; set use_sim_time alike for both"
    advice = ""
    if isinstance(reception.error, FrameError):
        advice = (
            f"; set frame:={reception.error.got}" if name == "odom" else "; expected the frame of odometry"
        )
    return f"messages of {node} are ignored: {reception.error}{advice}"


def _repeated(name: str, sender: Endpoint, reception: Reception, clock: ClockFacts) -> str:
    text = f"{name}: the stamps of {sender.node} stay at {reception.stamp:.2f} s"
    if sender.pauses:
        return f"{text}: it is paused; call its service pause with data: false"
    if clock.stopped:
        return f"{text}, {_clock(clock)}: the simulation is paused"
    return f"{text}: expected stamps that advance; is it paused, or does its driver not set them?"


def _clock(clock: ClockFacts) -> str:
    return f"/clock of {_several(clock.publishers)} does not advance"


def motion_cause(commands: TopicFacts, mismatch: str, rivals: Collection[str] = ()) -> str:
    """Return the most likely cause why a base does not follow its commands, else which nodes receive them.

    Parameters
    ----------
    commands : TopicFacts
        The topic of the commands.
    mismatch : str
        The problem if subscriptions have another type; empty if they have not.
    rivals : collection of str
        Other nodes that publish commands.
    """
    receivers = [other for other in commands.others if other.type == commands.type]
    if mismatch:
        return mismatch
    if not receivers:
        return _unconnected(commands, "subscribes to")
    unfit = next((receiver for receiver in receivers if receiver.incompatible), None)
    if unfit is not None:
        return f"{commands.name}: the quality of service of {unfit.node} does not fit: {unfit.incompatible}"
    if rivals:
        return f"{commands.name}: {_several(sorted(rivals))} publishes commands as well"
    return f"{commands.name} is received only by {_several(sorted({r.node for r in receivers}))}"


def _short(kind: str) -> str:
    """Return the short form of a type, such as geometry_msgs/Twist."""
    return kind.replace("/msg/", "/")


def _several(names: Collection[str]) -> str:
    """Return the first names as text, and how many more there are."""
    more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    return ", ".join(list(names)[:_MOST_NAMED]) + more


# What diagnostics report without a fault


def strange_senders(node: Node, topics: Mapping[str, type]) -> str:
    """Return which nodes publish another type than `node` subscribes to, by topic; empty if none does.

    ROS drops such messages silently.
    """
    return "; ".join(
        f"{topic}: expected {name}, {node_of(sender)} publishes {printable(sender.topic_type)}"
        for topic, kind in topics.items()
        for name in [type_name(kind)]
        for sender in node.get_publishers_info_by_topic(topic)
        if sender.topic_type != name
    )


def rival_senders(node: Node, topics: Iterable[str]) -> str:
    """Return the topics with several publishers, and the publishers' names. Each should have one source.

    Two simulations on one domain are an example. A publisher that was killed counts until DDS drops it after
    20 s.
    """
    senders = {topic: [node_of(s) for s in node.get_publishers_info_by_topic(topic)] for topic in topics}
    return "; ".join(
        f"{topic}: expected one publisher, got {len(names)}: {', '.join(sorted(names[:_MOST_NAMED]))}"
        for topic, names in senders.items()
        if len(names) > 1
    )
