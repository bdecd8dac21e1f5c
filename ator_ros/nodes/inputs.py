"""Subscriptions to the state of the world: the robot and the objects, from topics or tf.

tf is read from its messages; tf2_ros is not needed.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile

from ator_ros.nodes.parameters import STATE, SetupError
from ator_ros.nodes.qos import LATCHED_BY_MANY, RESULTS, SENSOR_DATA
from ator_ros.robot.description import Robot
from ator_ros.world.estimation import RobotVelocity
from ator_ros.world.messages import (
    MessageError,
    ObjectReader,
    ObjectSource,
    OdometryReader,
    robot_from_placement,
    transform_from,
)
from ator_ros.world.state import ObjectState, RobotState
from ator_ros.world.transforms import Placement, Transforms

Take = Callable[[float, Placement], None]
"""Takes the stamp of a frame in s, and its placement in another frame."""

try:
    from tf2_msgs.msg import TFMessage as TFMessage
except ImportError:  # ROS without tf
    TFMessage = None

_WARNING_PERIOD = 2.0
_MOST_NAMED = 8


@dataclass
class _Followed:
    """A frame that is looked up in another one; `last` is the stamp in s that was passed on last."""

    frame: str
    child: str
    take: Take
    last: float | None = None


class TfListener:
    """Subscribes to /tf and /tf_static once a frame is followed, and looks frames up.

    The names are absolute, as those of tf2_ros: where tf has a namespace, remap them (``-r /tf:=tf``).
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._transforms = Transforms()
        self._followed: list[_Followed] = []

    def lacking(self, frame: str, child: str) -> str:
        """Return the problem if the place of `child` in `frame` is unknown or old."""
        if self._transforms.latest(frame, child) is not None:
            return f"tf: expected newer transforms from {frame} to {child}"
        frames = self._transforms.frames
        known = f"{', '.join(frames[:_MOST_NAMED])}{' …' if len(frames) > _MOST_NAMED else ''}"
        return f"tf: expected transforms from {frame} to {child}, got the frames: {known or 'none'}"

    def follow(self, frame: str, child: str, take: Take) -> None:
        """Pass on each update of the pose of `child` in `frame`, in the order of these calls.

        Raises
        ------
        SetupError
            tf2_msgs is not installed.
        """
        if TFMessage is None:
            raise SetupError(f"{child} is to come from tf: expected the package tf2_msgs, got none")
        if not self._followed:
            for topic, fixed, qos in (("/tf_static", True, LATCHED_BY_MANY), ("/tf", False, RESULTS)):
                self._node.create_subscription(TFMessage, topic, partial(self._take, fixed=fixed), qos)
        self._followed.append(_Followed(frame, child, take))

    def _take(self, message: Any, *, fixed: bool) -> None:
        for transform in message.transforms:
            try:
                self._transforms.add(*transform_from(transform), fixed=fixed)
            except MessageError as error:
                logger = self._node.get_logger()
                logger.warning(f"ignored: {error}", throttle_duration_sec=_WARNING_PERIOD)
        for followed in self._followed:
            found = self._transforms.latest(followed.frame, followed.child)
            if found is not None and found[0] != followed.last:  # newer, or older after a reset
                followed.last = found[0]
                followed.take(*found)


@dataclass(frozen=True, slots=True)
class Input:
    """Where a node gets the robot or an object from: a topic and its type, or two frames in tf."""

    topic: str
    kind: Any
    qos: QoSProfile
    frames: tuple[str, str] | None = None

    @classmethod
    def of_tf(cls, frame: str, child: str) -> Input:
        """Return the input of the frame `child` in `frame`."""
        return cls("/tf", TFMessage, RESULTS, (frame, child))


class RobotSource:
    """Subscribes to the robot's state.

    `take` is called with time in s and state of the robot for each message, `reject` with "odom" and the
    error of a message that cannot be used, `warn` with a remark on one that is used although it is doubtful.

    Attributes
    ----------
    input : Input
        Where the state comes from.
    """

    def __init__(
        self,
        node: Node,
        settings: Mapping[str, Any],
        robot: Robot,
        take: Callable[[float, RobotState], None],
        reject: Callable[[str, MessageError], None],
        warn: Callable[[str], None],
        tf: TfListener,
    ) -> None:
        self._take, self._reject, self._warn = take, reject, warn
        frames = settings["frame"], settings["robot_frame"]
        self._reader = OdometryReader(settings["frame"])
        if settings[STATE.name] == "odom":
            self.input = Input("odom", Odometry, SENSOR_DATA)
            node.create_subscription(Odometry, "odom", partial(self._read, self._reader.read), SENSOR_DATA)
            return
        if len(set(frames)) < 2:
            raise SetupError(f"parameter robot_frame: expected another frame than frame, got {frames[1]}")
        self.input = Input.of_tf(*frames)
        velocity = RobotVelocity(robot.limits.v, robot.limits.w)
        tf.follow(*frames, partial(self._read, partial(robot_from_placement, velocity)))

    def _read(self, read: Callable[..., tuple[float, RobotState]], *message: Any) -> None:
        try:
            time, robot = read(*message)
        except MessageError as error:
            self._reject("odom", error)
            return
        if self._reader.remark:
            self._warn(self._reader.remark)
        self._take(time, robot)


TYPES: dict[str, Any] = {
    "Odometry": Odometry,
    "PoseStamped": PoseStamped,
    "PoseWithCovarianceStamped": PoseWithCovarianceStamped,
}


class ObjectSources:
    """Subscribes to the objects of a domain, which must be in the frame `frame`.

    `take` is called with name, time in s and state of an object for each message, `reject` with the name of
    an object and the error of a message that cannot be used.

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
                tf.follow(frame, source.listened, partial(self._read, source.name, reader.read_placement))
            else:
                callback = partial(self._read, source.name, reader.read)
                kind, topic = TYPES[source.type], source.listened
                self.inputs[source.name] = Input(topic, kind, SENSOR_DATA)
                node.create_subscription(kind, topic, callback, SENSOR_DATA)

    def _read(self, name: str, read: Callable[..., tuple[float, ObjectState]], *message: Any) -> None:
        try:
            time, there = read(*message)
        except MessageError as error:
            self._reject(name, error)
            return
        self._take(name, time, there)

    def diagnostics(self, known: Container[str], overdue: Container[str]) -> dict[str, str]:
        """Return the state of each object for diagnostics."""
        return {
            source.name: ("overdue" if source.name in overdue else "known")
            if source.name in known
            else "unknown"
            for source in self._sources
        }

    def missing(self, known: Container[str]) -> list[str]:
        """Return the required objects without a usable message."""
        return [item.name for item in self._sources if not item.optional and item.name not in known]
