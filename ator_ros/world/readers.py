"""Read ROS messages by their fields, checked and repaired, for nodes and recordings.

Every function raises MessageError, which names the place, the expected and the actual value.
Repairs: quaternions of any length are normalized, a leading slash of frames is ignored as in tf2,
and a velocity is rotated from the frame that `child_frame_id` names.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Collection, Sized
from dataclasses import dataclass
from typing import Any, Literal

from ator_ros.files import is_name
from ator_ros.geometry import Pose, yaw_from_quaternion
from ator_ros.printable import ReadableError, quoted
from ator_ros.schema import require
from ator_ros.world.robot_velocity import BEYOND_LIMITS, RobotVelocity, TwistCheck
from ator_ros.world.senders import PoseSenderCheck, SenderCheck
from ator_ros.world.sightings import VelocityEstimate
from ator_ros.world.state import Command, ObjectState, RobotState, World
from ator_ros.world.transforms import Placement, Quaternion, Transforms

Kind = Literal["Odometry", "PoseStamped", "PoseWithCovarianceStamped", "tf"]
"""Message types of objects, or tf; a missing velocity is estimated from the positions."""
RESERVED = ("robot", "hold", "goal")
"""Names in conditions that are not objects."""
_FRAME = re.compile(r"/?[A-Za-z0-9_][\w.-]*(/[\w.-]+)*", re.ASCII)
_TOPIC = re.compile(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)


@dataclass(frozen=True, slots=True)
class ObjectSource:
    """An object, and the topic of its state.

    If an object is `optional`, diagnostics do not report that it is unknown. A TOP whose conditions
    name it needs it anyway.
    """

    name: str  # in conditions
    topic: str = ""  # relative to the node's namespace, or absolute; empty: the name
    type: Kind = "Odometry"
    optional: bool = False
    frame: str = ""  # with type tf; empty: the name

    def __post_init__(self) -> None:
        """Raise SchemaError if a name is not valid."""
        named = is_name(self.name) and self.name not in RESERVED
        require(
            named,
            "name",
            f"a name of letters, digits and _, none of {', '.join(RESERVED)}",
            self.name,
        )
        right = not self.topic or bool(_TOPIC.fullmatch(self.topic))
        require(right, "topic", "the name of a topic", self.topic)
        named = not self.frame or bool(_FRAME.fullmatch(self.frame))
        require(named, "frame", "the name of a frame", self.frame)
        other = "frame" if self.type != "tf" else "topic"
        require(
            not getattr(self, other), other, f"none with type {self.type}", getattr(self, other)
        )

    @property
    def topic_or_frame(self) -> str:
        """The name of the topic, or of the frame without the leading slash that tf2 ignores."""
        return self.topic or self.frame.removeprefix("/") or self.name


FARTHEST = 1e8
"""Greatest coordinate in m: projected maps stay below the Earth's circumference, 4e7 m.

Beyond 1e8 m the 15 nm that a float64 resolves begin to matter to motions of one control tick.
"""
FASTEST = 100.0
"""Greatest velocity in m/s or rad/s, far above wheeled robots and what they push."""
_FASTEST_V = 20.0  # m/s; limit of a robot that is not described
_FASTEST_W = 50.0  # rad/s
_FASTEST_IN_OTHER_UNIT = 1e5  # `FASTEST` in mm/s, until the poses have shown the unit of a twist
MOST_OBJECTS = 16
"""Greatest number of objects in a situation."""
_ROUNDING = 1e-3  # m/s or rad/s that count as 0: filters and float32 leave such values
# length of a quaternion without direction: drivers without orientation send zeros
_NO_DIRECTION = 1e-6
# greatest length of a quaternion in a goal: rounded or added ones are shorter, degrees are longer
_LONGEST_TURN = 2.0
_MOST_TILTED = math.radians(30.0)  # greatest tilt of a robot; no ramp is steeper


class MessageError(ReadableError, ValueError):
    """A message that cannot be used; the text names the field, what was expected and the value."""


class FrameError(MessageError):
    """A message in another frame than expected; `got` is its frame."""

    def __init__(self, message: str, *, got: str) -> None:
        super().__init__(message)
        self.got = got


class SendersError(MessageError):
    """A message of one of two senders of the same quantity."""


# Numbers, names and sequences


def number(
    value: float,
    where: str,
    *,
    low: float,
    high: float,
    unit: str = "",
) -> float:
    """Return `value` if it is a finite number in [low, high].

    rclpy reads the memory of a whole number that a client assigns to a float field as if it were a
    float: negative ones arrive as NaN, and positive ones as denormal numbers.
    """
    value = float(value)
    denormal = 0.0 < abs(value) < sys.float_info.min
    if denormal or not (math.isfinite(value) and low <= value <= high):
        bounds = f"a finite number from {low:.10g} to {high:.10g} {unit}".rstrip()
        remedy = " (Python clients must assign 2.0, not 2)"
        hint = remedy if denormal or math.isnan(value) else ""
        raise MessageError(f"{where}: expected {bounds}, got {value!r}{hint}")
    return value


def position(value: float, where: str) -> float:
    """Return a coordinate in m if it is finite and at most `FARTHEST`."""
    return number(value, where, low=-FARTHEST, high=FARTHEST, unit="m")


def velocity(
    value: float,
    where: str,
    unit: str = "m/s",
) -> float:
    """Return a velocity if it is finite and at most `FASTEST`."""
    return number(value, where, low=-FASTEST, high=FASTEST, unit=unit)


def name(
    text: str,
    where: str,
    *,
    allowed: Collection[str],
) -> str:
    """Return a name if it is allowed."""
    if text not in allowed:
        raise MessageError(f"{where}: expected one of {sorted(allowed)}, got {quoted(text)}")
    return text


def count(
    items: Sized,
    where: str,
    *,
    least: int,
    most: int,
) -> None:
    """Raise MessageError unless there are `least` to `most` items."""
    if not least <= len(items) <= most:
        expected = f"{least}" if least == most else f"{least} to {most}"
        raise MessageError(f"{where}: expected {expected} items, got {len(items)}")


def names(
    items: Collection[str],
    where: str,
    *,
    allowed: Collection[str],
) -> frozenset[str]:
    """Return the names as a set if all are allowed and none is repeated."""
    found = frozenset(items)
    if len(found) < len(items) or not found.issubset(allowed):
        expected = f"names of {sorted(allowed)}, each once"
        raise MessageError(f"{where}: expected {expected}, got {quoted(', '.join(items))}")
    return found


# Stamps, frames and poses


def seconds_from(stamp: Any, where: str = "header.stamp") -> float:
    """Return a builtin_interfaces/Time in s; a float64 resolves 0.24 us of stamps since 1970."""
    if stamp.sec < 0 or not 0 <= stamp.nanosec < 1_000_000_000:
        got = f"{stamp.sec} s and {stamp.nanosec} ns"
        raise MessageError(f"{where}: expected a time since 0 s, with less than 1e9 ns, got {got}")
    return float(stamp.sec) + float(stamp.nanosec) * 1e-9


def plain_frame(frame_id: str) -> str:
    """Return a frame's name without a leading slash, which tf2 ignores."""
    return frame_id.removeprefix("/")


def expect_frame(
    frame_id: str,
    where: str,
    *,
    expected: str,
) -> None:
    """Raise FrameError unless a frame is the expected one or empty.

    If `expected` is empty, any will do.
    """
    if expected and plain_frame(frame_id) not in ("", plain_frame(expected)):
        text = f"{where}: expected the frame {quoted(expected)}, got {quoted(frame_id)}"
        raise FrameError(text, got=frame_id)


def rotation_from(quaternion: Any, where: str) -> Quaternion:
    """Return a quaternion (x, y, z, w) of length 1; raise MessageError if it has no direction."""
    parts = (quaternion.x, quaternion.y, quaternion.z, quaternion.w)
    length = math.hypot(*parts)
    if not _NO_DIRECTION < length < math.inf:
        raise MessageError(
            f"{where}: expected a quaternion (x, y, z, w) with a direction, got {parts}"
        )
    x, y, z, w = (float(part) / length for part in parts)
    return x, y, z, w


def _planar_yaw(rotation: Quaternion, where: str) -> float:
    x, y, z, w = rotation
    tilt = 2.0 * math.asin(min(1.0, math.hypot(x, y)))
    if tilt > _MOST_TILTED:
        raise MessageError(
            f"{where}: expected roll and pitch of at most "
            f"{math.degrees(_MOST_TILTED):.0f} degrees, "
            f"got the quaternion (x, y, z, w) ({x:.3f}, {y:.3f}, {z:.3f}, {w:.3f})"
        )
    return yaw_from_quaternion(x, y, z, w)


def pose_from(pose: Any, where: str) -> Pose:
    """Read a geometry_msgs/Pose as a pose in the plane."""
    return Pose(
        position(pose.position.x, f"{where}.position.x"),
        position(pose.position.y, f"{where}.position.y"),
        _planar_yaw(
            rotation_from(pose.orientation, f"{where}.orientation"), f"{where}.orientation"
        ),
    )


def goal_pose_from(pose: Any, where: str) -> Pose:
    """Read the pose of a goal, as `pose_from`.

    A quaternion of more than twice the length 1 is refused: its z may be an angle in degrees.
    """
    turn = pose.orientation
    length = math.hypot(turn.x, turn.y, turn.z, turn.w)
    if _LONGEST_TURN < length < math.inf:
        raise MessageError(
            f"{where}.orientation: expected a quaternion of length 1, got the length {length:.4g}; "
            f"for a "
            "heading in rad set z to sin(heading / 2) and w to cos(heading / 2)"
        )
    return pose_from(pose, where)


def transform_from(message: Any) -> tuple[str, str, float, Placement]:
    """Read a geometry_msgs/TransformStamped: frame, child frame, time (s), child's placement."""
    parent = plain_frame(message.header.frame_id)
    child = plain_frame(message.child_frame_id)
    if not (parent and child and parent != child):
        raise MessageError(f"tf: expected two frames, got {quoted(parent)} and {quoted(child)}")
    where = f"tf: {quoted(child)}"
    offset = message.transform.translation
    x, y, z = (position(getattr(offset, axis), f"{where}: {axis}") for axis in "xyz")
    placement = Placement((x, y, z), rotation_from(message.transform.rotation, where))
    return parent, child, seconds_from(message.header.stamp, f"{where}: stamp"), placement


# Commands, robots and objects


def command_from(message: Any, where: str) -> Command:
    """Read a geometry_msgs/Twist or TwistStamped, which must be in the plane."""
    twist = getattr(message, "twist", message)
    linear = twist.linear
    angular = twist.angular
    others = (linear.z, angular.x, angular.y)
    if not all(abs(value) <= _ROUNDING for value in others):
        unused = "linear.z, angular.x, angular.y"
        raise MessageError(
            f"{where}: {unused}: expected 0, since the robot moves in the plane, got {others}"
        )
    return Command(
        velocity(linear.x, f"{where}.linear.x"),
        velocity(angular.z, f"{where}.angular.z", "rad/s"),
        vy=velocity(linear.y, f"{where}.linear.y"),
    )


def robot_from_placement(
    estimate: RobotVelocity,
    time: float,
    placement: Placement,
    moved: tuple[float, Placement] | None = None,
) -> tuple[float, RobotState]:
    """Read time in s and state of the robot from its placement in tf; its velocity is estimated.

    `moved` is a time and a placement in odometry's frame, from which the velocity is derived:
    corrections of the pose by localization are no motion. None: the velocity is derived from
    `placement`.
    """
    pose = pose_from_placement(placement, "robot in tf")
    stamp, unmapped = (time, placement) if moved is None else moved
    state = estimate.state(stamp, pose_from_placement(unmapped, "robot in tf"))
    return time, RobotState(pose, state.vx, state.w, vy=state.vy)


def pose_from_placement(placement: Placement, where: str) -> Pose:
    """Read the pose in the plane of a placement in tf."""
    x, y, _ = placement.origin
    yaw = _planar_yaw(placement.turn, f"{where}: rotation")
    return Pose(position(x, f"{where}: x"), position(y, f"{where}: y"), yaw)


class OdometryReader:
    """Reads the odometry of one robot in the order of arrival.

    Poses must be in the frame `frame`; empty: in that of the first message. The attribute `frame`
    is the frame of the poses, once it is known. Velocities that contradict the poses are replaced,
    unless `corrects` is false: a recording is corrected as a whole. `is_shared`: see `SenderCheck`.
    Lateral velocities are read if the base moves `sideways`, else they are 0. `limits` (m/s, rad/s)
    are those of the robot, by which a twist in another unit is recognized.
    """

    def __init__(
        self,
        frame: str = "",
        *,
        corrects: bool = True,
        is_shared: Callable[[], bool] | None = None,
        sideways: bool = False,
        limits: tuple[float, float] | None = None,
    ) -> None:
        self.frame = plain_frame(frame)
        self._sideways = sideways
        self.remark = ""
        """That pose and twist contradict each other, after the message that showed it; else empty.

        Then the poses decide."""
        v, w = limits or (_FASTEST_V, _FASTEST_W)
        self._check = TwistCheck((BEYOND_LIMITS * v, BEYOND_LIMITS * w)) if corrects else None
        self._senders = PoseSenderCheck(is_shared)

    def read(self, odometry: Any) -> tuple[float, RobotState]:
        """Return time in s and state of the robot from a nav_msgs/Odometry.

        The twist is the robot's own, unless `child_frame_id` is the frame of the pose: then it is
        rotated.
        """
        given = odometry.header.frame_id
        expect_frame(given, "odom.header.frame_id", expected=self.frame)
        pose = pose_from(odometry.pose.pose, "odom.pose.pose")
        twist = odometry.twist.twist
        most = FASTEST if self._check is None else _FASTEST_IN_OTHER_UNIT
        vx = number(twist.linear.x, "odom.twist.twist.linear.x", low=-most, high=most, unit="m/s")
        vy = 0.0
        in_pose_frame = _is_pose_frame(odometry.child_frame_id, given, self.frame)
        if in_pose_frame or self._sideways:
            vy = velocity(twist.linear.y, "odom.twist.twist.linear.y")
        if in_pose_frame:
            cos = math.cos(pose.yaw)
            sin = math.sin(pose.yaw)
            vx, vy = vx * cos + vy * sin, vy * cos - vx * sin
        where = "odom.twist.twist.angular.z"
        w = number(twist.angular.z, where, low=-most, high=most, unit="rad/s")
        time = seconds_from(odometry.header.stamp, "odom.header.stamp")
        robot = RobotState(pose, vx, w, vy=vy if self._sideways else 0.0)
        self.frame = self.frame or plain_frame(given)
        if difference := self._senders.difference(time, *pose):
            raise SendersError(f"odom: {_to_and_fro(difference)}")
        if self._check is None:
            return time, robot
        checked, found = self._check.check(time, robot)
        child = quoted(odometry.child_frame_id)
        asked = "" if self._check.unit else f"; is the twist in the frame child_frame_id {child}?"
        self.remark = f"odom: {found}{asked}" if found else ""
        return time, checked


class ObjectReader:
    """Reads the messages of one object in the order of arrival; missing velocities are estimated.

    Positions must be in the frame `frame`; empty: any. `is_shared`: see `SenderCheck`; without it,
    two senders are not recognized, as detections of one object may jump to and fro.
    """

    def __init__(
        self,
        source: ObjectSource,
        frame: str = "",
        *,
        is_shared: Callable[[], bool] = lambda: False,
    ) -> None:
        self._source = source
        self.frame = frame
        self._estimate = VelocityEstimate()
        self._senders = SenderCheck(is_shared)

    def read(self, message: Any) -> tuple[float, ObjectState]:
        """Return time in s and state of the object from a message of the source's type."""
        where = self._source.name
        given = message.header.frame_id
        expect_frame(given, f"{where}.header.frame_id", expected=self.frame)
        time = seconds_from(message.header.stamp, f"{where}.header.stamp")
        pose = message.pose if self._source.type == "PoseStamped" else message.pose.pose
        x = position(pose.position.x, f"{where}.pose: position.x")
        y = position(pose.position.y, f"{where}.pose: position.y")
        if distance := self._senders.distance(time, x, y):
            raise SendersError(f"{where}: {_to_and_fro(f'{distance:.2f} m')}")
        if self._source.type != "Odometry":
            return time, self._estimate.state(time, x, y)
        linear = message.twist.twist.linear
        vx = velocity(linear.x, f"{where}.twist: x")
        vy = velocity(linear.y, f"{where}.twist: y")
        child = message.child_frame_id
        if child and not _is_pose_frame(child, given, self.frame) and (vx or vy):
            vz = velocity(linear.z, f"{where}.twist: z")
            turn = rotation_from(pose.orientation, f"{where}.pose.pose.orientation")
            vx, vy, _ = (
                Placement((0.0, 0.0, 0.0), turn).compose(Placement((vx, vy, vz), turn)).origin
            )
        return time, ObjectState(x, y, vx, vy)

    def read_placement(self, time: float, placement: Placement) -> tuple[float, ObjectState]:
        """Return time in s and state of the object from its placement in tf."""
        where = f"{self._source.name} in tf"
        x = position(placement.origin[0], f"{where}.x")
        y = position(placement.origin[1], f"{where}.y")
        return time, self._estimate.state(time, x, y)


def _forward(situation: Any) -> Any:
    """Return the forward velocity of a Situation, which recordings of version 0.2 call v."""
    return situation.vx if hasattr(situation, "vx") else situation.v


def world_from(
    situation: Any,
    *,
    frame: str = "",
    where: str = "situation",
) -> World:
    """Read an ator_interfaces/Situation, which must be in the frame `frame`; empty: in any."""
    expect_frame(situation.header.frame_id, f"{where}.header.frame_id", expected=frame)
    robot = RobotState(
        pose_from(situation.robot, f"{where}.robot"),
        velocity(_forward(situation), f"{where}.vx"),
        velocity(situation.w, f"{where}.w", "rad/s"),
        vy=velocity(getattr(situation, "vy", 0.0), f"{where}.vy"),
    )
    count(situation.objects, f"{where}.objects", least=0, most=MOST_OBJECTS)
    objects: dict[str, ObjectState] = {}
    for index, item in enumerate(situation.objects):
        place = f"{where}.objects[{index}]"
        if not is_name(item.name):
            raise MessageError(
                f"{place}.name: expected a name of letters, digits and _, got {quoted(item.name)}"
            )
        objects[item.name] = ObjectState(
            position(item.position.x, f"{place}.position: x"),
            position(item.position.y, f"{place}.position: y"),
            velocity(item.velocity.x, f"{place}.velocity: x"),
            velocity(item.velocity.y, f"{place}.velocity: y"),
        )
    if len(objects) != len(situation.objects):
        raise MessageError(f"{where}.objects: expected each name once, got one twice")
    return World(seconds_from(situation.header.stamp, f"{where}.header.stamp"), robot, objects)


def check_senders(
    transforms: Transforms,
    frame: str,
    child: str,
) -> None:
    """Raise SendersError if a transform between two frames comes from two senders."""
    if problem := second_parent(transforms, frame, child):
        raise SendersError(problem)
    if found := transforms.second_sender(frame, child):
        parent, name, difference = found
        raise SendersError(f"tf: {quoted(parent)} to {quoted(name)}: {_to_and_fro(difference)}")


def second_parent(
    transforms: Transforms,
    frame: str,
    child: str,
) -> str:
    """Return that a frame between two frames has two parents in turn, and the remedy; else ""."""
    parents = transforms.second_parent(frame, child)
    if parents is None:
        return ""
    name, one, other = (quoted(each) for each in parents)
    return (
        f"tf: {name}: expected one parent, got {one} and {other} in turn; "
        f"end one of the nodes that "
        "publish it"
    )


def _to_and_fro(difference: str) -> str:
    """Return what two senders that differ by a number with its unit look like, and the remedy."""
    return (
        f"expected one sender, got poses that jump to and fro by {difference}; end one of the "
        "nodes that publish it"
    )


def _is_pose_frame(
    child: str,
    given: str,
    expected: str,
) -> bool:
    """Return whether a twist is in the frame of the pose."""
    return plain_frame(child) in {plain_frame(given), plain_frame(expected)} - {""}
