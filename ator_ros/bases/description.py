"""The description of a differential-drive robot and of the scene around it, read from YAML."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from ator_ros.files import FileError, content_with_optional_header, read_yaml
from ator_ros.geometry import Pose
from ator_ros.printable import ReadableError
from ator_ros.resources import resource_path
from ator_ros.schema import TITLE, SchemaError, Within, structured
from ator_ros.world.grid_map import GridMap
from ator_ros.world.scene import Mass, Scene, Size
from ator_ros.world.state import World

KIND = "robot"
"""The kind of such files, which their header may state."""
SHIPPED = ("config", "pioneer.yaml")
"""The default description."""
_LARGEST = 100_000  # bytes of a description; ours has 2 kB
_MOST_WHEEL = 0.49  # greatest share of the robot's mass in one wheel
_LOOSE = 2.0  # widths of an object above which the gap between the fingers is too wide to hold it
_SAME_RADIUS = 0.1  # share by which an object's radius may differ from the holder's
LEAST, GREATEST = 0.01, {"v": 20.0, "w": 50.0, "a": 100.0, "brake": 100.0, "aw": 1000.0}
"""The bounds of `Limits`: tables of turns take 3 MB for each m/s, and greater values are in wrong units."""


class ConfigError(ReadableError, ValueError):
    """A configuration file that cannot be used; the message names file, field and expectation."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Greatest speeds and accelerations, the same forward and backward unless `v_back` is 0."""

    v: Annotated[float, Within(LEAST, GREATEST["v"])]  # m/s
    w: Annotated[float, Within(LEAST, GREATEST["w"])]  # rad/s
    a: Annotated[float, Within(LEAST, GREATEST["a"])]  # m/s^2; gaining speed
    brake: Annotated[float, Within(LEAST, GREATEST["brake"])]  # m/s^2; losing speed
    aw: Annotated[float, Within(LEAST, GREATEST["aw"])]  # rad/s^2
    v_back: float | None = None  # m/s; greatest speed backward: 0, or None for `v`

    def __post_init__(self) -> None:
        """Replace a `v_back` of `v` by None; raise ValueError if it is neither that nor 0."""
        if self.v_back == self.v:
            object.__setattr__(self, "v_back", None)
        elif self.v_back not in (None, 0.0):
            raise ValueError(
                f"v_back: expected 0, for a base that never drives backward, or v ({self.v:g}), "
                f"got {self.v_back:g}"
            )

    @property
    def backward(self) -> float:
        """Greatest speed backward in m/s: 0 or `v`."""
        return self.v if self.v_back is None else self.v_back

    def scaled(self, factor: float) -> Limits:
        """Return these limits times `factor`."""
        return dataclasses.replace(
            self, **{name: factor * getattr(self, name) for name in GREATEST}
        )

    def within(self, other: Limits) -> Limits:
        """Return the smaller of both limits in each value."""
        least = {name: min(getattr(self, name), getattr(other, name)) for name in GREATEST}
        v_back = 0.0 if 0.0 in (self.v_back, other.v_back) else None
        return Limits(**least, v_back=v_back)


@dataclass(frozen=True, slots=True)
class Holder:
    """Two parallel fingers at the robot's front, which hold a round object from the sides.

    Sizes in m.
    """

    length: Size
    gap: Size  # between the inner sides of the fingers
    thickness: Size
    radius: Size  # of the held object
    limits: Limits  # for commands while it is held

    @property
    def half_width(self) -> float:
        """Distance in m from the robot's middle axis to the outside of a finger."""
        return self.gap / 2 + self.thickness

    @property
    def held_width(self) -> float:
        """Width in m of the held object between the fingers when it touches the front."""
        deep = min(self.length, self.radius)
        return 2.0 * math.sqrt(deep * (2.0 * self.radius - deep))


@dataclass(frozen=True, slots=True)
class StopBraking:
    """Deceleration of a base on a command to stop, which exceeds that of `Limits`."""

    # m/s^2; above 4.5 a small base tips
    forward: Annotated[float, Within(LEAST, GREATEST["brake"])] = 4.0
    backward: Annotated[float, Within(LEAST, GREATEST["brake"])] = 5.0  # m/s^2; driving backward
    turning: Annotated[float, Within(LEAST, GREATEST["aw"])] = 12.0  # rad/s^2


@dataclass(frozen=True, slots=True)
class Build:
    """Details of the body for the simulation; `simulation.urdf` derives those that are None."""

    # m; center of mass, behind the axle
    mass_behind: Annotated[float, Within(0.0, 10.0)] | None = None
    mass_height: Size | None = None  # m; center of mass, above the floor
    caster_behind: Size | None = None  # m; from the axle back to the caster
    wheel_mass: Mass | None = None  # kg; of each wheel
    # kg m^2; of each wheel with its motor at the wheel. 1 g and 1 cm have 1e-7, 100 kg and 1 m have
    # 100.
    wheel_inertia: Annotated[float, Within(1e-7, 100.0)] | None = None
    front_friction: Annotated[float, Within(0.0, 10.0)] = 0.15  # between the front and an object


@dataclass(frozen=True, slots=True)
class Base:
    """A differential-drive robot with or without a holder: the section `robot` of a description.

    Lengths in m from the middle of the axle, mass in kg, torque in N m, time in s. `grip` is the
    centripetal acceleration in m/s^2 above which its wheels may slide: rubber on a hard floor holds
    about 0.6 g, and two driven wheels carry about 0.7 of the weight.
    """

    name: Annotated[str, TITLE]
    wheel_radius: Size
    track: Size
    mass: Mass
    front: Size
    rear: Size
    half_width: Size
    # Torques from a toy's to a 10 t vehicle's. A time constant of 0.1 ms is below the simulation's
    # step, and with 10 s a base does not follow its commands. `grip` up to 10 g.
    wheel_torque: Annotated[float, Within(0.001, 10_000.0)]
    motor_time_constant: Annotated[float, Within(0.0001, 10.0)]
    limits: Limits
    holder: Holder | None = None
    stop: StopBraking = StopBraking()
    grip: Annotated[float, Within(0.01, 100.0)] = 4.0
    build: Build = Build()


@dataclass(frozen=True, slots=True, kw_only=True)
class Robot(Base):
    """A robot, its scene, and the map of the building if there is one; see `Base`."""

    scene: Scene
    grid: GridMap | None = None

    def __post_init__(self) -> None:
        """Raise ConfigError if sizes, masses or torques contradict each other."""
        build, holder = self.build, self.holder
        caster = self.rear if build.caster_behind is None else build.caster_behind
        width, torque = (
            2.0 * self.half_width,
            least_torque(self.mass, self.wheel_radius, self.limits),
        )
        if holder is not None and holder.limits.v_back not in (None, self.limits.v_back):
            raise ConfigError(
                "robot.holder.limits.v_back: expected none, as robot.limits.v_back holds with and "
                f"without an object, got {holder.limits.v_back:g}"
            )
        _at_most(
            "build.wheel_mass", build.wheel_mass, _MOST_WHEEL * self.mass, "as the body has a mass"
        )
        _at_most("build.caster_behind", build.caster_behind, self.rear, "where the robot ends")
        _at_most("build.mass_behind", build.mass_behind, caster, "where the robot is supported")
        _at_least(
            "wheel_torque", self.wheel_torque, torque, f"which {self.mass:g} kg need to accelerate"
        )
        _at_most("track", self.track, width, "the width of the robot with its wheels")
        if holder is not None:
            least, most = (
                _rounded_up(holder.held_width),
                math.floor(1e4 * _LOOSE * holder.held_width) / 1e4,
            )
            _at_least("holder.gap", holder.gap, least, "the width of the held object")
            _at_most("holder.gap", holder.gap, most, "as the fingers must hold the object")

    def __hash__(self) -> int:
        """Hash the name only, as tables are looked up by the robot in every search."""
        return hash(self.name)

    @property
    def holder_length(self) -> float:
        """Length in m of the holder; 0 without one."""
        return self.holder.length if self.holder else 0.0

    @property
    def tip(self) -> float:
        """Distance in m from the axle to the foremost part of the robot."""
        return self.front + self.holder_length

    @property
    def tip_half_width(self) -> float:
        """Half of the width in m of the foremost part, which is the holder if there is one."""
        return self.holder.half_width if self.holder else self.half_width

    @property
    def hold(self) -> float:
        """Distance in m from the axle to the center of a held object; `front` without a holder."""
        return self.front + (self.holder.radius if self.holder else 0.0)

    @property
    def reach(self) -> float:
        """Distance in m from the axle to the farthest point of the robot."""
        body = math.hypot(max(self.front, self.rear), self.half_width)
        return max(math.hypot(self.tip, self.tip_half_width), body)

    def holder_for(self, what: str) -> Holder:
        """Return the holder, which `what` needs; raise ConfigError if the robot has none."""
        if self.holder is None:
            raise ConfigError(f"{what} needs a holder; robot {self.name} has none")
        return self.holder

    def hold_point(self, pose: Pose) -> Pose:
        """Return the pose of the hold (where a held object's center lies) of a robot at `pose`."""
        return pose.ahead(self.hold)

    def hold_offset(self, world: World, name: str) -> float:
        """Return the distance in m from an object to the hold.

        Infinite if the object is unknown.
        """
        state = world.objects.get(name)
        if state is None:
            return math.inf
        hold = self.hold_point(world.robot.pose)
        return math.hypot(state.x - hold.x, state.y - hold.y)

    def pose_holding(self, hold: Pose) -> Pose:
        """Return the robot's pose with its hold at `hold`; the inverse of `hold_point`."""
        return hold.ahead(-self.hold)

    def sections(self) -> dict[str, Any]:
        """Return the content of a file that describes this robot and its scene, without defaults."""
        content = self._content()
        scene = content.pop("scene")
        defaults = {field.name: field.default for field in dataclasses.fields(self)}
        robot = {
            name: value for name, value in content.items() if getattr(self, name) != defaults[name]
        }
        return {"robot": robot, "scene": scene}

    def digest(self) -> str:
        """Return a short digest of base and holder, without name, scene and map.

        Learned files contain it.
        """
        content = self._content()
        del content["name"], content["scene"]
        return _digest_of(content)

    def description_digest(self) -> str:
        """Return a short digest of everything on which simulated results depend, with scene and map."""
        content = self._content()
        return _digest_of(content if self.grid is None else {**content, "grid": str(self.grid)})

    def _content(self) -> dict[str, Any]:
        """Return all fields but the map, nested ones as dicts, without a default `v_back`."""
        content = dataclasses.asdict(dataclasses.replace(self, grid=None))
        del content["grid"]
        for section in filter(None, (content, content["holder"])):
            if section["limits"]["v_back"] is None:
                del section["limits"]["v_back"]
        return content


def _digest_of(content: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]


@dataclass(frozen=True, slots=True)
class Description:
    """The content of a file."""

    robot: Base
    scene: Scene


def load_robot(path: Path | str | None = None) -> Robot:
    """Read the description of a robot and of the scene around it, by default the shipped file.

    Raises
    ------
    ConfigError
        The file cannot be read, or a field is missing, unknown or out of its range.
    """
    file = Path(path) if path is not None else resource_path(*SHIPPED)
    try:
        return robot_of(content_with_optional_header(read_yaml(file, largest=_LARGEST), KIND))
    except FileError as error:
        raise ConfigError(str(error)) from error
    except (SchemaError, ConfigError) as error:
        raise ConfigError(f"{file}: {error}") from error


def robot_of(content: Any) -> Robot:
    """Return the robot that the content of a file describes; raises SchemaError or ConfigError."""
    read = structured(content, Description)
    fields = {item.name: getattr(read.robot, item.name) for item in dataclasses.fields(read.robot)}
    robot = Robot(**fields, scene=read.scene)
    _check_held(robot)
    return robot


def _at_least(field: str, value: float, least: float, why: str) -> None:
    if value < least:
        raise ConfigError(f"robot.{field}: expected at least {least:g}, {why}, got {value:g}")


def _at_most(field: str, value: float | None, most: float, why: str) -> None:
    if value is not None and value > most:
        raise ConfigError(f"robot.{field}: expected at most {most:g}, {why}, got {value:g}")


def least_torque(mass: float, wheel_radius: float, limits: Limits) -> float:
    """Return the torque in N m of each of two wheels that accelerate a mass (kg) by the limits: F = m a."""
    return _rounded_up(0.5 * mass * max(limits.a, limits.brake) * wheel_radius)


def _check_held(robot: Robot) -> None:
    """Raise ConfigError if the holder fits no object of the scene.

    Without objects, the domain adds them.
    """
    holder, radii = robot.holder, {name: each.radius for name, each in robot.scene.objects.items()}
    if holder is None or not radii:
        return
    if all(abs(radius - holder.radius) > _SAME_RADIUS * holder.radius for radius in radii.values()):
        known = ", ".join(f"{name} {radius:g}" for name, radius in radii.items())
        raise ConfigError(
            f"robot.holder.radius: expected that of an object of the scene ({known}), got {holder.radius:g}"
        )


def _rounded_up(value: float) -> float:
    """Return `value` rounded up to four digits after the point, so that the printed bound is accepted."""
    return math.ceil(1e4 * value) / 1e4
