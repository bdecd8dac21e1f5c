"""The executor's topics of the active chain, its path and the objects; markers for RViz."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import Point, PoseStamped
from nav_msgs.msg import Path
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from ator_interfaces.msg import ChainPerformance
from ator_ros.bases.description import Robot
from ator_ros.domains.domain import Domain
from ator_ros.execution.supervisor import Phase, Supervisor
from ator_ros.geometry import FloatArray, Pose
from ator_ros.nodes.goal_run import GoalRun
from ator_ros.nodes.messages import pose_of, stamp_of
from ator_ros.nodes.qos import LATCHED
from ator_ros.nodes.segments import (
    ORANGE,
    WHITE,
    Label,
    Segments,
    executed_chain_shapes,
    station_labels,
    surroundings,
)
from ator_ros.world.state import ObjectState, World

_ABOVE_FLOOR = 0.02  # m: height of the lines, above the grid that RViz draws
_POINT = 0.05  # m: radius with which an object of unknown size is drawn
_TEXT = 0.25  # m: height of texts, and above the floor
_PERIOD = 0.2  # s on odometry's clock, between two updates
_ROUNDING = 1e-6  # s; stamps are sums of floats
_MOST_POSES = 60  # of planned_path: 0.1 m apart on a drive of 6 m


class ExecutionDrawing:
    """Publishes the active goal, five times a second and transient local.

    Publishes
        planned_path (nav_msgs/Path): the path that the active action has planned; empty without
        one. chain_markers (visualization_msgs/MarkerArray): the active chain; its current subgoal
        in orange. object_markers (visualization_msgs/MarkerArray): the objects. chain_under_way
        (ator_interfaces/ChainPerformance): the active chain; until it ends its outcome has
            code 0, and predictions are left out.
        scene_markers (visualization_msgs/MarkerArray): area, bays, and the domain's lines.
    """

    def __init__(self, node: Node, domain: Domain, robot: Robot, frame: str) -> None:
        self._scene = robot.scene
        self._frame = frame
        self._path = LazyPublisher(node, Path, "planned_path")
        self._chain = LazyPublisher(node, MarkerArray, "chain_markers")
        self._objects = LazyPublisher(node, MarkerArray, "object_markers")
        self._surroundings = LazyPublisher(node, MarkerArray, "scene_markers")
        self._surroundings.publish(
            lambda: marker_array(surroundings(domain, robot), "scene", frame)
        )
        self._under_way = LazyPublisher(node, ChainPerformance, "chain_under_way")
        self._state: tuple[object, ...] = ()  # `GoalRun.published_state` of the last update
        self._drawn_at = self._objects_at = -math.inf  # s on odometry's clock; last updates

    def follow(self, run: GoalRun, world: World | None) -> None:
        """Publish the status of a goal and draw its chain; `world` is the newest state."""
        now = 0.0 if world is None else world.time
        state = run.published_state
        is_new = state != self._state
        self._state = state
        if is_new:
            self._chain.publish(partial(self._chain_message, run.supervisor))
        if is_new or abs(now - self._drawn_at) >= _PERIOD - _ROUNDING:
            self._drawn_at = now
            self._path.publish(partial(self._path_message, run.supervisor.path(), now))
            if world is not None:
                self._under_way.publish(partial(run.record, world))

    def objects(self, world: World) -> None:
        """Draw the objects of the newest state, five times a second."""
        if abs(world.time - self._objects_at) >= _PERIOD - _ROUNDING:
            self._objects_at = world.time
            spheres = (
                _sphere(state, self._scene.radius(name)) for name, state in world.objects.items()
            )
            self._objects.publish(lambda: _array(spheres, "objects", self._frame))

    def _chain_message(self, supervisor: Supervisor) -> MarkerArray:
        shapes: list[Segments] = []
        labels: list[Label] = []
        if supervisor.phase is Phase.EXECUTING and supervisor.start is not None:
            start = supervisor.start.robot.pose
            executor = supervisor.executor
            shapes = executed_chain_shapes(start, executor.chain, executor.index)
            labels = station_labels(executor.chain)
        return marker_array(shapes, "chain", self._frame, labels)

    def _path_message(self, path: FloatArray | None, now: float) -> Path:
        message = Path()
        message.header.frame_id = self._frame
        message.header.stamp = stamp_of(now)
        if path is not None and len(path):
            kept = np.linspace(0, len(path) - 1, min(len(path), _MOST_POSES)).round().astype(int)
            for row in path[kept].tolist():
                message.poses.append(PoseStamped(header=message.header, pose=pose_of(Pose(*row))))
        return message


class LazyPublisher:
    """A latched topic whose newest message is built only once it has a subscriber."""

    def __init__(self, node: Node, kind: type[Any], topic: str) -> None:
        self._factory: Callable[[], Any] | None = None
        matched = PublisherEventCallbacks(
            matched=lambda _: self._send(), use_default_callbacks=False
        )
        self._publisher = node.create_publisher(kind, topic, LATCHED, event_callbacks=matched)

    def publish(self, factory: Callable[[], Any]) -> None:
        """Publish what `factory` returns once there is a subscriber, unless replaced before."""
        self._factory = factory
        self._send()

    def _send(self) -> None:
        if self._factory is not None and self._publisher.get_subscription_count():
            factory = self._factory
            self._factory = None
            self._publisher.publish(factory())


def marker_array(
    shapes: Iterable[Segments], namespace: str, frame: str, labels: Iterable[Label] = ()
) -> MarkerArray:
    """Return markers in the namespace, which replace those of the previous message."""
    lines = (_segments(shape) for shape in shapes if len(shape.points))
    return _array((*lines, *map(_text, labels)), namespace, frame)


def _array(drawn: Iterable[Marker], namespace: str, frame: str) -> MarkerArray:
    markers = [Marker(action=Marker.DELETEALL), *drawn]
    for number, marker in enumerate(markers):
        marker.header.frame_id = frame
        marker.ns = namespace
        marker.id = number
    return MarkerArray(markers=markers)


def _segments(shape: Segments) -> Marker:
    marker = Marker(type=Marker.LINE_LIST, pose=pose_of(Pose(0.0, 0.0, 0.0)))
    marker.scale.x = shape.width
    for ends, color in zip(shape.points.tolist(), shape.colors.tolist(), strict=True):
        marker.points += [Point(x=x, y=y, z=_ABOVE_FLOOR) for x, y in ends]
        marker.colors += [_color(*color)] * 2
    return marker


def _text(label: Label) -> Marker:
    marker = Marker(type=Marker.TEXT_VIEW_FACING, text=label.text, color=_color(*WHITE))
    marker.pose = pose_of(Pose(label.x, label.y, 0.0))
    marker.pose.position.z = _TEXT
    marker.scale.z = _TEXT
    return marker


def _sphere(state: ObjectState, radius: float) -> Marker:
    marker = Marker(
        type=Marker.SPHERE, color=_color(*ORANGE), pose=pose_of(Pose(state.x, state.y, 0.0))
    )
    size = 2.0 * max(radius, _POINT)
    marker.pose.position.z = size / 2.0
    marker.scale.x = marker.scale.y = marker.scale.z = size
    return marker


def _color(red: float, green: float, blue: float) -> ColorRGBA:
    return ColorRGBA(r=float(red), g=float(green), b=float(blue), a=1.0)
