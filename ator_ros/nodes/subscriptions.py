"""Subscriptions to the state of the robot and the objects, from topics or tf.

Tf2_ros is not needed.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.qos import QoSProfile
from tf2_msgs.msg import TFMessage

from ator_ros.bases.description import Robot
from ator_ros.geometry import Pose
from ator_ros.nodes.parameters import STATE, SetupError
from ator_ros.nodes.qos import LATCHED_BY_MANY, NEWEST, RESULTS, SENSOR_DATA
from ator_ros.printable import listed, one_line, printable, quoted
from ator_ros.world.readers import (
    MessageError,
    ObjectReader,
    ObjectSource,
    OdometryReader,
    check_senders,
    plain_frame,
    pose_from_placement,
    robot_from_placement,
    second_parent,
    transform_from,
)
from ator_ros.world.robot_velocity import RobotVelocity
from ator_ros.world.sightings import StampError
from ator_ros.world.state import ObjectState, RobotState
from ator_ros.world.transforms import Placement, Transforms

# takes a frame's stamp in s and its placement in another frame
Take = Callable[[float, Placement], None]
GAPS = 5
"""Last gaps between messages whose median counts: one or two may be lost or late messages."""
MOST_NAMED = 8
"""Frames or nodes in a message, which is one line."""
WARNING_PERIOD = 2.0
"""Real s between two warnings that one line of code logs."""


class TfListener:
    """Subscribes to /tf and /tf_static once a frame is used, and looks up frames in `transforms`.

    The topics are absolute, as those of tf2_ros. If tf has a namespace, remap them (``-r
    /tf:=tf``).
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.transforms = Transforms()
        self._subscriptions: dict[bool, Any] = {}  # by whether the transforms are fixed
        self._followed: dict[tuple[str, str], list[Take]] = {}
        self._last: dict[tuple[str, str], float] = {}  # stamp in s that was passed on last

    def problem(self, frame: str, child: str) -> str:
        """Return the problem if the place of `child` in `frame` is unknown or old."""
        ours = f"from {printable(frame)} to {printable(child)}"
        if parents := second_parent(self.transforms, frame, child):
            return parents
        if self.transforms.latest(frame, child) is not None:
            return f"tf: expected newer transforms {ours}"
        frames = listed(map(printable, self.transforms.frames), MOST_NAMED) or "none"
        return one_line(f"tf: expected transforms {ours}, got the frames: {frames}")

    def base(self, frame: str, other: str) -> Pose | None:
        """Return the pose of another frame in `frame`; None if it is unknown, or the same frame."""
        if plain_frame(other) in ("", plain_frame(frame)):
            return None
        self._subscribe()
        found = self.transforms.latest(plain_frame(frame), plain_frame(other))
        return None if found is None else pose_from_placement(found[1], f"{quoted(other)} in tf")

    def pose_at(self, frame: str, child: str, time: float) -> Pose | None:
        """Return the pose of `child` in `frame` at a time in s; None if it is unknown."""
        self._subscribe()
        found = self.transforms.at(frame, child, time)
        return None if found is None else pose_from_placement(found, f"{quoted(child)} in tf")

    def follow(self, frame: str, child: str, take: Take) -> None:
        """Pass on each update of the pose of `child` in `frame`.

        The frames first followed come first.
        """
        self._subscribe()
        self._followed.setdefault((frame, child), []).append(take)

    def _subscribe(self) -> None:
        if not self._subscriptions:
            for topic, fixed, qos in (
                ("/tf_static", True, LATCHED_BY_MANY),
                ("/tf", False, RESULTS),
            ):
                self._subscriptions[fixed] = self._node.create_subscription(
                    TFMessage, topic, partial(self._take, fixed=fixed), qos
                )

    def _take(self, message: Any, *, fixed: bool) -> None:
        """Add the transforms of all messages that wait; pass on the newest poses only."""
        self._add(message, fixed=fixed)
        subscription = self._subscriptions[fixed]
        for _ in range(subscription.qos_profile.depth):  # more may come meanwhile
            with subscription.handle:
                waiting = subscription.handle.take_message(subscription.msg_type, subscription.raw)
            if waiting is None:
                break
            self._add(waiting[0], fixed=fixed)
        for frames, takes in self._followed.items():
            found = self.transforms.latest(*frames)
            # newer, or older after a reset
            if found is not None and found[0] != self._last.get(frames):
                self._last[frames] = found[0]
                for take in takes:
                    take(*found)

    def _add(self, message: Any, *, fixed: bool) -> None:
        for transform in message.transforms:
            try:
                self.transforms.add(*transform_from(transform), fixed=fixed)
            except MessageError as error:
                logger = self._node.get_logger()
                logger.warning(f"ignored: {error}", throttle_duration_sec=WARNING_PERIOD)


class _NeverExecuted(CallbackGroup):
    """The group of subscriptions for which no executor waits."""

    def can_execute(self, entity: Any) -> bool:  # noqa: ARG002
        """Return False."""
        return False


class PolledTopic:
    """The newest message of a topic, taken when it is needed: those in between cost no time."""

    def __init__(self, node: Node, kind: type[Any], topic: str, qos: QoSProfile = NEWEST) -> None:
        self._subscription = node.create_subscription(
            kind, topic, lambda _: None, qos, callback_group=_NeverExecuted()
        )

    def take(self) -> Any:
        """Return the newest message since the last call; None without one."""
        subscription = self._subscription
        with subscription.handle:
            waiting = subscription.handle.take_message(subscription.msg_type, subscription.raw)
        return None if waiting is None else waiting[0]


TYPES: dict[str, Any] = {
    "Odometry": Odometry,
    "PoseStamped": PoseStamped,
    "PoseWithCovarianceStamped": PoseWithCovarianceStamped,
}


@dataclass(slots=True)
class Input:
    """The source of a state, a topic or two frames in tf, and its last messages.

    `last` is the real time in s of the last message, `advanced` that of the last one with a new
    `stamp` (s), and `gaps` are the real s between the last of those. `error` is why the last
    message was ignored.
    """

    topic: str
    kind: Any
    qos: QoSProfile
    frames: tuple[str, str] | None = None
    last: float = -math.inf
    advanced: float = math.nan
    stamp: float = math.nan
    gaps: deque[float] = field(default_factory=lambda: deque(maxlen=GAPS))
    error: Exception | None = None

    def read(self, stamp: float, now: float) -> None:
        """Record a message that could be read, with its stamp in s, at `now` in real s."""
        self.last = now
        self.error = None
        if stamp == self.stamp:
            return
        if now > self.advanced:
            self.gaps.append(now - self.advanced)
        self.stamp = stamp
        self.advanced = now


class Subscriptions:
    """Subscribes to the state of a robot and of objects.

    `inputs` are the sources by name, "odom" that of the robot.

    Parameters
    ----------
    settings : mapping
        The parameters `frame`, in which all of them must be, `robot_frame` and `robot_from`.
    take_robot, take_object : callable
        Called with time in s and state of the robot, and with name, time and state of an object.
        They may raise StampError.
    warn : callable
        Called with a warning about a message that is ignored, or used although it is doubtful.

    Raises SetupError if `robot_frame` is `frame` and the robot's state comes from tf.
    """

    def __init__(
        self,
        node: Node,
        settings: Mapping[str, Any],
        robot: Robot,
        sources: Iterable[ObjectSource],
        *,
        take_robot: Callable[[float, RobotState], None],
        take_object: Callable[[str, float, ObjectState], None],
        warn: Callable[[str], object],
    ) -> None:
        self._node = node
        self._warn = warn
        self.tf = TfListener(node)
        self.inputs = dict[str, Input]()
        frame, robot_frame = frames = settings["frame"], settings["robot_frame"]
        # Objects first: when several messages wait, those of objects are then processed before
        # odometry.
        for source in sources:
            shared = partial(self._is_shared, source.topic_or_frame)
            reader = ObjectReader(source, frame, is_shared=shared)
            take = partial(take_object, source.name)
            if source.type == "tf":
                self._follow(
                    source.name, (frame, source.topic_or_frame), reader.read_placement, take
                )
            else:
                item = Input(source.topic_or_frame, TYPES[source.type], SENSOR_DATA)
                self._subscribe(source.name, item, reader.read, take)
        if settings[STATE.name] == "odom":
            odometry = OdometryReader(
                frame,
                is_shared=partial(self._is_shared, "odom"),
                sideways=robot.moves_sideways,
                limits=(robot.greatest_speed(), robot.greatest_turn_rate),
            )
            take_odometry = partial(self._take_odometry, odometry, take_robot)
            self._subscribe(
                "odom", Input("odom", Odometry, SENSOR_DATA), odometry.read, take_odometry
            )
        elif frame == robot_frame:
            raise SetupError(
                f"parameter robot_frame: expected another frame than frame, got {robot_frame}"
            )
        else:
            velocity = RobotVelocity(
                robot.greatest_speed(), robot.greatest_turn_rate, sideways=robot.moves_sideways
            )
            transforms = self.tf.transforms

            def read(stamp: float, placement: Placement) -> tuple[float, RobotState]:
                check_senders(transforms, *frames)
                moved = transforms.latest_in_odometry(*frames)
                return robot_from_placement(velocity, stamp, placement, moved)

            self._follow("odom", frames, read, take_robot)

    def _subscribe(
        self, name: str, item: Input, read: Callable[..., Any], take: Callable[..., None]
    ) -> None:
        self.inputs[name] = item
        self._node.create_subscription(
            item.kind, item.topic, partial(self._take, name, read, take), item.qos
        )

    def _follow(
        self,
        name: str,
        frames: tuple[str, str],
        read: Callable[..., Any],
        take: Callable[..., None],
    ) -> None:
        self.inputs[name] = Input("/tf", TFMessage, RESULTS, frames)
        self.tf.follow(*frames, partial(self._take, name, read, take))

    def _is_shared(self, topic: str) -> bool:
        """Return whether the graph lists several publishers of a topic."""
        return bool(self._node.count_publishers(topic) > 1)

    def _take(
        self, name: str, read: Callable[..., Any], take: Callable[..., None], *message: Any
    ) -> None:
        now = time.monotonic()
        item = self.inputs[name]
        try:
            stamp, state = read(*message)
            item.read(stamp, now)
            take(stamp, state)
        except (MessageError, StampError) as error:
            item.last = now
            item.error = error
            self._warn(f"ignored: {error}")

    def _take_odometry(
        self, reader: OdometryReader, take: Callable[..., None], stamp: float, robot: RobotState
    ) -> None:
        if reader.remark:
            self._warn(reader.remark)
        take(stamp, robot)
