"""The robot's shape and limits, the ball and the field, read from `config/pioneer.yaml`."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from ator_ros.geometry import Pose
from ator_ros.plain_yaml import UnreadableYamlError, read_yaml
from ator_ros.resources import resource_path
from ator_ros.world.state import Field, ObjectState, World

T = TypeVar("T")
_STANDING = 1e-3  # m/s up to which a ball counts as standing
_LARGEST = 100_000  # bytes of a description; ours has 2 kB
# Plausible ranges: learned features, tables of turns and the physics rely on them.
_LENGTH = (0.001, 10.0)
_BOUNDS: dict[str, tuple[float, float]] = {
    **dict.fromkeys(("mass", "wheel_torque"), (0.001, 10_000.0)),
    "motor_time_constant": (0.0001, 10.0),
    "v": (0.01, 5.0),  # tables of turns grow with it
    "w": (0.01, 50.0),
    **dict.fromkeys(("a", "brake"), (0.01, 100.0)),
    "aw": (0.01, 1000.0),
    "rolling_deceleration": (0.001, 100.0),
    "restitution": (0.0001, 1.0),
    **dict.fromkeys(("length", "width", "goal_width", "goal_depth", "margin"), (0.001, 1000.0)),
}


class ConfigError(ValueError):
    """A configuration file that cannot be used; the message names file, field and expectation."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Greatest speeds (m/s, rad/s) and accelerations (m/s^2, rad/s^2), the same forward and backward.

    `a` holds for gaining speed, `brake` for losing it.
    """

    v: float
    w: float
    a: float
    brake: float
    aw: float

    def scaled(self, factor: float) -> Limits:
        """Return these limits times `factor`."""
        return Limits(*(factor * getattr(self, field.name) for field in dataclasses.fields(self)))

    def within(self, other: Limits) -> Limits:
        """Return the smaller of both limits in each of the five values."""
        names = (field.name for field in dataclasses.fields(self))
        return Limits(*(min(getattr(self, name), getattr(other, name)) for name in names))


@dataclass(frozen=True, slots=True)
class Ball:
    """The ball: radius in m, mass in kg, deceleration in m/s^2 when it rolls freely, restitution."""

    radius: float
    mass: float
    rolling_deceleration: float
    restitution: float

    def at_rest(self, ball: ObjectState) -> ObjectState:
        """Return the state in which the ball comes to rest if nothing stops it before."""
        if ball.speed < _STANDING:
            return ball
        seconds = ball.speed / (2.0 * self.rolling_deceleration)
        return ObjectState(ball.x + ball.vx * seconds, ball.y + ball.vy * seconds)


@dataclass(frozen=True, slots=True)
class Robot:
    """A differential-drive robot whose front holds a ball between two fins.

    Lengths in m from the middle of the axle, mass in kg, torque in N m, time in s. `limits` holds
    for the base, `dribble_limits` for commands with the ball in front.
    """

    name: str
    wheel_radius: float
    track: float
    mass: float
    front: float
    rear: float
    half_width: float
    fin_length: float
    fin_gap: float
    fin_thickness: float
    wheel_torque: float
    motor_time_constant: float
    limits: Limits
    dribble_limits: Limits
    ball: Ball
    field: Field

    @property
    def hold(self) -> float:
        """Distance in m from the axle to the centre of a ball that lies against the front."""
        return self.front + self.ball.radius

    @property
    def reach(self) -> float:
        """Distance in m from the axle to the farthest point of the robot, the tip of a fin."""
        return math.hypot(self.front + self.fin_length, self.fin_gap / 2 + self.fin_thickness)

    def hold_point(self, pose: Pose) -> Pose:
        """Return the pose of the hold (where a held ball's centre lies) of a robot at `pose`."""
        return pose.ahead(self.hold)

    def hold_offset(self, world: World, name: str) -> float:
        """Return the distance in m from an object to the hold; infinite if the object is unknown."""
        there = world.objects.get(name)
        if there is None:
            return math.inf
        hold = self.hold_point(world.robot.pose)
        return math.hypot(there.x - hold.x, there.y - hold.y)

    def pose_holding(self, ball: Pose) -> Pose:
        """Return the robot's pose that holds a ball at (ball.x, ball.y) with heading ball.yaw."""
        return ball.ahead(-self.hold)

    def digest(self) -> str:
        """Return a short digest of the whole description, stored with everything that is learned."""
        text = json.dumps(dataclasses.asdict(self), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def load_robot(path: Path | str | None = None) -> Robot:
    """Read the robot's description.

    Parameters
    ----------
    path : Path or str, optional
        A YAML file; by default the shipped `config/pioneer.yaml`.

    Raises
    ------
    ConfigError
        The file cannot be read, or a field is missing, unknown or out of its range.
    """
    file = Path(path) if path is not None else resource_path("config", "pioneer.yaml")
    try:
        data = read_yaml(file, largest=_LARGEST)
    except UnreadableYamlError as error:
        raise ConfigError(str(error)) from error
    root = _section(data, "", file, {"robot", "ball", "field"})
    robot = dict(_section(root["robot"], "robot", file, None))
    for name in ("limits", "dribble_limits"):
        robot[name] = _build(Limits, robot.get(name), f"robot.{name}", file)
    robot["ball"] = _build(Ball, root["ball"], "ball", file)
    robot["field"] = _build(Field, root["field"], "field", file)
    return _build(Robot, robot, "robot", file)


def _section(data: Any, where: str, file: Path, keys: set[str] | None) -> Mapping[str, Any]:
    if not isinstance(data, Mapping):
        raise ConfigError(f"{file}: {where or 'top level'}: expected a mapping, got {type(data).__name__}")
    if keys is not None and set(data) != keys:
        wrong = sorted(str(key) for key in set(data) ^ keys)
        raise ConfigError(
            f"{file}: {where or 'top level'}: expected the fields {sorted(keys)}; "
            f"missing or unknown: {_short(wrong)}"
        )
    return data


def _build(kind: type[T], data: Any, where: str, file: Path) -> T:
    fields = dataclasses.fields(kind)  # type: ignore[arg-type]
    section = _section(data, where, file, {field.name for field in fields})
    return kind(**{field.name: _value(field, section[field.name], where, file) for field in fields})


def _value(field: dataclasses.Field[Any], value: Any, where: str, file: Path) -> Any:
    if field.type == "str":
        if not isinstance(value, str):
            raise ConfigError(f"{file}: {where}.{field.name}: expected a text, got {_short(value)}")
        return value
    if field.type != "float":
        return value
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not 0.0 < value <= sys.float_info.max:
        raise ConfigError(f"{file}: {where}.{field.name}: expected a positive number, got {_short(value)}")
    low, high = _BOUNDS.get(field.name, _LENGTH)
    if not low <= value <= high:
        raise ConfigError(
            f"{file}: {where}.{field.name}: expected a number from {low:g} to {high:g}, got {value:g}"
        )
    return float(value)


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 200 else f"{text[:200]}..."
