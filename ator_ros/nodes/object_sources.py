"""Subscriptions to where objects are: topics of Odometry, PoseStamped or PoseWithCovarianceStamped, or tf."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable
from functools import partial
from typing import Any

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node

from ator_ros.nodes.diagnosis import Input
from ator_ros.nodes.qos import SENSOR_DATA
from ator_ros.nodes.tf_listener import Found, TfListener
from ator_ros.world.messages import MessageError, ObjectReader, ObjectSource
from ator_ros.world.state import ObjectState

TYPES: dict[str, Any] = {
    "Odometry": Odometry,
    "PoseStamped": PoseStamped,
    "PoseWithCovarianceStamped": PoseWithCovarianceStamped,
}


class ObjectSources:
    """Subscribes to the objects of a domain.

    Parameters
    ----------
    node : Node
        The node that subscribes.
    sources : iterable of ObjectSource
        The objects.
    take : callable
        Is given name, time in s and state of an object for each message.
    reject : callable
        Is given the name of an object and the error of a message that cannot be used.
    tf : TfListener
        Looks up objects in tf.
    frame : str
        The frame that objects must be in.

    Attributes
    ----------
    inputs : dict of str to Input
        Where each object comes from, by its name.
    """

    def __init__(
        self,
        node: Node,
        sources: Iterable[ObjectSource],
        take: Callable[[str, float, ObjectState], None],
        reject: Callable[[str, MessageError], None],
        tf: TfListener,
        *,
        frame: str,
    ) -> None:
        self._sources, self._take, self._reject = tuple(sources), take, reject
        self.inputs: dict[str, Input] = {}
        for source in self._sources:
            reader = ObjectReader(source, frame)
            if source.type == "tf":
                self.inputs[source.name] = Input.of_tf(frame, source.listened)
                tf.follow(frame, source.listened, partial(self._take_found, source.name, reader))
            else:
                callback = partial(self._take_message, source.name, reader)
                kind, topic = TYPES[source.type], source.listened
                self.inputs[source.name] = Input(topic, kind)
                node.create_subscription(kind, topic, callback, SENSOR_DATA)

    def _take_message(self, name: str, reader: ObjectReader, message: Any) -> None:
        try:
            time, there = reader.read(message)
        except MessageError as error:
            self._reject(name, error)
            return
        self._take(name, time, there)

    def _take_found(self, name: str, reader: ObjectReader, found: Found) -> None:
        try:
            time, there = reader.read_placement(found.time, found.placement)
        except MessageError as error:
            self._reject(name, error)
            return
        self._take(name, time, there)

    def told(self, known: Container[str], overdue: Container[str]) -> dict[str, str]:
        """Return what diagnostics say of each object."""
        return {
            source.name: ("overdue" if source.name in overdue else "known")
            if source.name in known
            else "unknown"
            for source in self._sources
        }

    def missing(self, known: Container[str]) -> list[str]:
        """Return which objects are not known that should be."""
        return [item.name for item in self._sources if not item.optional and item.name not in known]
