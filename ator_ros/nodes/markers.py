"""Markers for RViz, and publishers that build their messages only for subscribers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from geometry_msgs.msg import Point
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of
from ator_ros.nodes.qos import LATCHED
from ator_ros.view.shapes import ORANGE, Arrow, Segments, Shape
from ator_ros.world.scene import Scene
from ator_ros.world.state import ObjectState

_ABOVE_FLOOR = 0.02
_SHAFT = 0.05
_POINT = 0.05
"""Radius in m with which an object of unknown size is drawn."""


class LazyPublisher:
    """A latched topic whose newest message is built only once it has a subscriber, early or late.

    Parameters
    ----------
    node : Node
        The node that publishes.
    kind : type
        Of the messages.
    topic : str
        Name of the topic.
    """

    def __init__(self, node: Node, kind: type[Any], topic: str) -> None:
        self._factory: Callable[[], Any] | None = None
        matched = PublisherEventCallbacks(matched=lambda _: self._send(), use_default_callbacks=False)
        self._publisher = node.create_publisher(kind, topic, LATCHED, event_callbacks=matched)

    def publish(self, factory: Callable[[], Any]) -> None:
        """Publish what `factory` returns, now or once there is a subscriber; a newer one replaces it."""
        self._factory = factory
        self._send()

    def _send(self) -> None:
        if self._factory is not None and self._publisher.get_subscription_count():
            factory, self._factory = self._factory, None
            self._publisher.publish(factory())


def marker_array(shapes: Iterable[Shape], space: str, frame: str) -> MarkerArray:
    """Return markers in the namespace `space`; all that were there before are deleted."""
    return _array(
        (
            _segments(shape) if isinstance(shape, Segments) else _arrow(shape)
            for shape in shapes
            if not isinstance(shape, Segments) or len(shape.points)
        ),
        space,
        frame,
    )


def object_array(objects: Mapping[str, ObjectState], scene: Scene, frame: str) -> MarkerArray:
    """Return spheres where objects are; those that were there before are deleted."""
    return _array((_sphere(there, scene.radius(name)) for name, there in objects.items()), "objects", frame)


def _array(drawn: Iterable[Marker], space: str, frame: str) -> MarkerArray:
    markers = [Marker(action=Marker.DELETEALL), *drawn]
    for number, marker in enumerate(markers):
        marker.header.frame_id, marker.ns, marker.id = frame, space, number
    return MarkerArray(markers=markers)


def _segments(shape: Segments) -> Marker:
    marker = Marker(type=Marker.LINE_LIST, pose=pose_of(Pose(0.0, 0.0, 0.0)))
    marker.scale.x = shape.width
    for ends, colour in zip(shape.points.tolist(), shape.colours.tolist(), strict=True):
        marker.points += [Point(x=x, y=y, z=_ABOVE_FLOOR) for x, y in ends]
        marker.colors += [_colour(*colour)] * 2
    return marker


def _arrow(shape: Arrow) -> Marker:
    marker = Marker(type=Marker.ARROW, color=_colour(*shape.colour), pose=pose_of(shape.pose))
    marker.pose.position.z = _ABOVE_FLOOR
    marker.scale.x, marker.scale.y, marker.scale.z = shape.length, _SHAFT, _SHAFT
    return marker


def _sphere(there: ObjectState, radius: float) -> Marker:
    marker = Marker(type=Marker.SPHERE, color=_colour(*ORANGE), pose=pose_of(Pose(there.x, there.y, 0.0)))
    size = 2.0 * max(radius, _POINT)
    marker.pose.position.z = size / 2.0
    marker.scale.x = marker.scale.y = marker.scale.z = size
    return marker


def _colour(red: float, green: float, blue: float) -> ColorRGBA:
    return ColorRGBA(r=float(red), g=float(green), b=float(blue), a=1.0)
