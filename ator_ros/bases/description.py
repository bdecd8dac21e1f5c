"""The description of a robot and of the scene around it, read from YAML."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Annotated, Any, ClassVar, get_type_hints

from ator_ros.bases.interface import Base
from ator_ros.files import FileError, content_with_optional_header, read_yaml
from ator_ros.geometry import Pose
from ator_ros.printable import ReadableError, quoted
from ator_ros.resources import resource_path
from ator_ros.schema import TITLE, SchemaError, structured
from ator_ros.world.grid_map import GridMap
from ator_ros.world.scene import Scene, Size
from ator_ros.world.state import World

KIND = "robot"
"""The kind of such files, which their header may state."""
SHIPPED = ("config", "pioneer.yaml")
"""The default description."""
GROUP = "ator_ros.bases"
"""The group of entry points by which packages add kinds of bases: subclasses of `Robot`."""
DEFAULT_DRIVE = "differential"
"""The kind of base of a file without the field `drive`."""
_SHIPPED_DRIVES = (
    EntryPoint(DEFAULT_DRIVE, "ator_ros.bases.differential.robot:DifferentialRobot", GROUP),
    EntryPoint("omni", "ator_ros.bases.omni.omni_robot:OmniRobot", GROUP),
)
_LARGEST = 100_000  # bytes of a description; ours has 2 kB
_LOOSE = 2.0  # widths of an object above which the gap between the fingers is too wide to hold it
_SAME_RADIUS = 0.1  # share by which an object's radius may differ from the holder's


class ConfigError(ReadableError, ValueError):
    """A configuration file that cannot be used; the message names file, field and expectation."""


@dataclass(frozen=True, slots=True)
class Holder:
    """Two parallel fingers at the robot's front, which hold a round object from the sides.

    Sizes in m.
    """

    length: Size
    gap: Size  # between the inner sides of the fingers
    thickness: Size
    radius: Size  # of the held object

    @property
    def half_width(self) -> float:
        """Distance in m from the robot's middle axis to the outside of a finger."""
        return self.gap / 2 + self.thickness

    @property
    def held_width(self) -> float:
        """Width in m of the held object between the fingers when it touches the front."""
        deep = min(self.length, self.radius)
        return 2.0 * math.sqrt(deep * (2.0 * self.radius - deep))


@dataclass(frozen=True, slots=True, kw_only=True)
class Robot(Base):
    """A robot with or without a holder, its scene, and the map of the building if there is one.

    Subclasses describe how it moves, see `Base`; their fields are those of the section `robot` of a
    file whose field `drive` names them. Lengths in m from the point of the robot whose pose is
    estimated: with two driven wheels, the middle of the axle.
    """

    drive: ClassVar[str]
    """The name of this kind of base, in the field `drive` of a file."""

    name: Annotated[str, TITLE]
    front: Size
    rear: Size
    half_width: Size
    holder: Holder | None = None
    scene: Scene
    grid: GridMap | None = None

    def __post_init__(self) -> None:
        """Raise ConfigError if the holder cannot hold its object."""
        holder = self.holder
        if holder is not None:
            least = rounded_up(holder.held_width)
            most = math.floor(1e4 * _LOOSE * holder.held_width) / 1e4
            at_least("holder.gap", holder.gap, least, "the width of the held object")
            at_most("holder.gap", holder.gap, most, "as the fingers must hold the object")

    @classmethod
    def kind_for(cls, section: Mapping[str, Any]) -> type[Robot]:  # noqa: ARG003
        """Return the class for the content of the section `robot` of a file."""
        return cls

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
        """Return the content of a file that describes this robot and scene, without defaults."""
        content = self.content()
        scene = content.pop("scene")
        defaults = {field.name: field.default for field in dataclasses.fields(self)}
        robot = {
            name: value
            for name, value in content.items()
            if name == "drive" or getattr(self, name) != defaults[name]
        }
        return {"robot": robot, "scene": scene}

    def digest(self) -> str:
        """Return a short digest of base and holder, without name, scene and map.

        Learned files contain it.
        """
        content = self.content()
        del content["name"], content["scene"]
        return _digest_of(content)

    def description_digest(self) -> str:
        """Return a short digest of all that simulated results depend on, with scene and map."""
        content = self.content()
        return _digest_of(content if self.grid is None else {**content, "grid": str(self.grid)})

    def content(self) -> dict[str, Any]:
        """Return all fields but the map, nested ones as dicts, and `drive` if not the default."""
        content = dataclasses.asdict(dataclasses.replace(self, grid=None))
        del content["grid"]
        return content if self.drive == DEFAULT_DRIVE else {"drive": self.drive, **content}


def _digest_of(content: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]


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
    section = content.get("robot") if isinstance(content, Mapping) else None
    described = section if isinstance(section, Mapping) else {}
    kind = kind_of(described.get("drive", DEFAULT_DRIVE)).kind_for(described)
    read: Any = structured(content, _file_schema(kind))
    fields = {item.name: getattr(read.robot, item.name) for item in dataclasses.fields(read.robot)}
    del fields["drive"]
    robot = kind(**fields, scene=read.scene)
    _check_held(robot)
    return robot


def kind_of(drive: object) -> type[Robot]:
    """Return the class of robots with this `drive`: a shipped one, or an entry point of `GROUP`.

    Raises ConfigError if there is none.
    """
    found = {entry.name: entry for entry in (*_SHIPPED_DRIVES, *entry_points(group=GROUP))}
    if drive not in found:
        raise ConfigError(
            f"robot.drive: expected one of {', '.join(sorted(found))}, got {quoted(drive)}"
        )
    kind: type[Robot] = found[str(drive)].load()
    return kind


@functools.cache
def _file_schema(kind: type[Robot]) -> type:
    """Return the dataclass of a file's content: the sections robot, of this `kind`, and scene."""
    hints = get_type_hints(kind, include_extras=True)
    own = [item for item in dataclasses.fields(kind) if item.name not in ("scene", "grid")]
    section = dataclasses.make_dataclass(
        kind.__name__,
        [
            *(
                (item.name, hints[item.name], dataclasses.field(default=item.default))
                for item in own
            ),
            ("drive", str, dataclasses.field(default=kind.drive)),
        ],
        kw_only=True,
    )
    return dataclasses.make_dataclass("Description", [("robot", section), ("scene", Scene)])


def _check_held(robot: Robot) -> None:
    """Raise ConfigError if the holder fits no object of the scene.

    Without objects, the domain adds them.
    """
    holder = robot.holder
    radii = {name: each.radius for name, each in robot.scene.objects.items()}
    if holder is None or not radii:
        return
    if all(abs(radius - holder.radius) > _SAME_RADIUS * holder.radius for radius in radii.values()):
        known = ", ".join(f"{name} {radius:g}" for name, radius in radii.items())
        raise ConfigError(
            f"robot.holder.radius: expected that of an object of the scene ({known}), "
            f"got {holder.radius:g}"
        )


def at_least(field: str, value: float, least: float, why: str) -> None:
    """Raise ConfigError about a field of the section `robot` whose value is too small."""
    if value < least:
        raise ConfigError(f"robot.{field}: expected at least {least:g}, {why}, got {value:g}")


def at_most(field: str, value: float | None, most: float, why: str) -> None:
    """Raise ConfigError about a field of the section `robot` whose value is too great."""
    if value is not None and value > most:
        raise ConfigError(f"robot.{field}: expected at most {most:g}, {why}, got {value:g}")


def rounded_up(value: float) -> float:
    """Return `value` rounded up to 1e-4, so that the printed bound is accepted."""
    return math.ceil(1e4 * value) / 1e4
