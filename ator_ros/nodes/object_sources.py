"""What tells where objects are: topics of Odometry, PoseStamped or PoseWithCovarianceStamped, or tf."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable
from functools import partial
from typing import Any

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node

from ator_ros.nodes import checks
from ator_ros.nodes.checks import MessageBounds
from ator_ros.nodes.conversions import object_from, seconds_from
from ator_ros.nodes.qos import SENSOR_DATA
from ator_ros.nodes.tf_listener import Found, TfListener
from ator_ros.world.sources import ObjectSource
from ator_ros.world.state import ObjectState
from ator_ros.world.velocity import VelocityEstimate

TYPES: dict[str, Any] = {
    "Odometry": Odometry,
    "PoseStamped": PoseStamped,
    "PoseWithCovarianceStamped": PoseWithCovarianceStamped,
}
Reader = Callable[[Any], tuple[float, ObjectState]]
"""Returns time in s and state of an object of a message; raises MessageError."""


class ObjectSources:
    """Listens to the objects of a domain.

    Parameters
    ----------
    node : Node
        Who listens.
    sources : iterable of ObjectSource
        The objects.
    take : callable
        Is given the name of an object, a reader, and a message for it.
    tf : TfListener
        Looks up objects in tf.
    frame : str
        The frame that objects must be in.
    bounds : MessageBounds
        Greatest values accepted.
    group : CallbackGroup, optional
        Of the subscriptions, tf excepted.

    Attributes
    ----------
    topics : dict of str to type
        The types of the messages by the names of the topics, tf excepted.
    """

    def __init__(
        self,
        node: Node,
        sources: Iterable[ObjectSource],
        take: Callable[[str, Reader, Any], None],
        tf: TfListener,
        *,
        frame: str,
        bounds: MessageBounds,
        group: CallbackGroup | None = None,
    ) -> None:
        self._sources = tuple(sources)
        self.topics = {item.listened: TYPES[item.type] for item in self._sources if item.type in TYPES}
        for source in self._sources:
            reader = reader_of(source, frame=frame, bounds=bounds)
            callback = partial(take, source.name, reader)
            if source.type == "tf":
                tf.follow(frame, source.listened, callback)
            else:
                kind, topic = TYPES[source.type], source.listened
                node.create_subscription(kind, topic, callback, SENSOR_DATA, callback_group=group)

    def told(self, known: Container[str], overdue: Container[str]) -> dict[str, str]:
        """Return what diagnostics say of each object."""
        return {
            source.name: ("overdue" if source.name in overdue else "known")
            if source.name in known
            else "unknown"
            for source in self._sources
        }

    def missing(self, known: Container[str]) -> str:
        """Return which objects are not known that should be; empty where there is none."""
        names = [item.name for item in self._sources if not item.optional and item.name not in known]
        return f"{', '.join(names)}: expected on its topic, got nothing recent" if names else ""


def reader_of(source: ObjectSource, *, frame: str, bounds: MessageBounds) -> Reader:
    """Return what reads the messages of an object in the order of their arrival."""
    if source.type == "Odometry":
        return partial(object_from, frame=frame, where=source.name, bounds=bounds)
    estimate = VelocityEstimate()
    if source.type == "tf":
        return partial(_found, source, estimate, bounds)
    return partial(_positioned, source, estimate, frame, bounds)


def _found(
    source: ObjectSource, estimate: VelocityEstimate, bounds: MessageBounds, found: Found
) -> tuple[float, ObjectState]:
    """Read an object's position from tf; the velocity is estimated."""
    x, y, _ = found.placement.origin
    return found.time, _seen_at(estimate, found.time, x, y, f"{source.name} in tf", bounds)


def _positioned(
    source: ObjectSource, estimate: VelocityEstimate, frame: str, bounds: MessageBounds, message: Any
) -> tuple[float, ObjectState]:
    """Read a message with a pose; the velocity is estimated."""
    checks.frame(message.header.frame_id, f"{source.name}.header.frame_id", expected=frame)
    covariant = source.type == "PoseWithCovarianceStamped"
    position = (message.pose.pose if covariant else message.pose).position
    time = seconds_from(message.header.stamp)
    where = f"{source.name}.pose: position"
    return time, _seen_at(estimate, time, position.x, position.y, where, bounds)


def _seen_at(
    estimate: VelocityEstimate, time: float, x: float, y: float, where: str, bounds: MessageBounds
) -> ObjectState:
    x = checks.position(x, f"{where}.x", most=bounds.x)
    y = checks.position(y, f"{where}.y", most=bounds.y)
    return estimate.state(time, x, y)
