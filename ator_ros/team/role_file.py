"""The roles of a team, declared in a YAML file (docs/roles.md)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from ator_ros.actions.base import Point
from ator_ros.actions.goal_variables import GOAL_VARIABLES
from ator_ros.bases.description import Robot
from ator_ros.files import FileError, read_yaml
from ator_ros.geometry import Pose
from ator_ros.refinement.refiner import LONGEST_CHAIN, MOST_ALTERNATIVES
from ator_ros.schema import (
    NAME,
    NOT_EMPTY,
    Must,
    SchemaError,
    Within,
    require,
    structured,
)
from ator_ros.tops.chain import EVERYTHING, TopCall, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import ObjectState

MOST_ROLES = 16
"""Most roles of a team: `Roles.msg` has a pair of each with each of as many robots."""
_LARGEST = 100_000  # bytes of a file


@dataclass(frozen=True, slots=True)
class RoleStep:
    """One step of a role's chain.

    Attributes
    ----------
    x, y, yaw : float
        Its goal in m and rad; with `at` relative to where this object comes to rest.
    open : tuple of str
        Goal variables that refinement may change.
    """

    top: str
    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    at: str = ""
    open: tuple[str, ...] = ()

    def pose(
        self,
        objects: Mapping[str, ObjectState],
        origin: Pose,
    ) -> Pose:
        """Return the goal; raises KeyError if the object is unknown."""
        if not self.at:
            return origin.compose(Pose(self.x, self.y, self.yaw))
        there = objects[self.at]
        return Pose(there.x, there.y, origin.yaw).compose(Pose(self.x, self.y, self.yaw))


Steps = Annotated[
    tuple[RoleStep, ...],
    NOT_EMPTY,
    Must(f"at most {LONGEST_CHAIN}", lambda steps: len(steps) <= LONGEST_CHAIN),
]


@dataclass(frozen=True, slots=True)
class Role:
    """A role: a chain, and other chains for the same end.

    `weight` is what a second of this role counts, beside one of the others.
    """

    name: Annotated[str, NAME]
    steps: Steps
    alternatives: tuple[Steps, ...] = ()
    weight: Annotated[float, Within(0.01, 100.0)] = 1.0

    def __post_init__(self) -> None:
        few = len(self.alternatives) <= MOST_ALTERNATIVES
        require(few, "alternatives", f"at most {MOST_ALTERNATIVES}", len(self.alternatives))

    def chains(
        self,
        library: TopLibrary,
        objects: Mapping[str, ObjectState],
        origin: Pose,
    ) -> list[TopChain]:
        """Return the chains for objects that rest at known places; none if one is unknown.

        `origin` is the frame of the file. Goals beside an object are moved into the area.
        """
        try:
            return [
                TopChain(tuple(_call(step, library, objects, origin) for step in steps))
                for steps in (self.steps, *self.alternatives)
            ]
        except KeyError:
            return []


@dataclass(frozen=True, slots=True)
class RoleFile:
    """A file of roles, the most important ones first. `frame` is theirs; empty: the node's."""

    roles: Annotated[tuple[Role, ...], NOT_EMPTY]
    frame: str = ""

    def __post_init__(self) -> None:
        names = [role.name for role in self.roles]
        require(len(names) <= MOST_ROLES, "roles", f"at most {MOST_ROLES}", len(names))
        require(len(set(names)) == len(names), "roles", "different names", names)


def load_roles(
    path: Path,
    library: TopLibrary,
    objects: tuple[str, ...],
) -> RoleFile:
    """Read roles whose steps have TOPs of `library`, and these objects of the domain.

    Raises FileError.
    """
    try:
        read = structured(read_yaml(path, largest=_LARGEST), RoleFile)
        for number, role in enumerate(read.roles):
            for steps in (role.steps, *role.alternatives):
                for step in steps:
                    _check(step, f"roles[{number}]", library, objects)
    except SchemaError as error:
        raise FileError(f"{path}: {error}") from error
    return read


def _check(
    step: RoleStep,
    where: str,
    library: TopLibrary,
    objects: tuple[str, ...],
) -> None:
    require(step.top in library, f"{where}: top", f"one of {sorted(library)}", step.top)
    require(step.at in ("", *objects), f"{where}: at", f"one of {list(objects)}", step.at)
    known = {*GOAL_VARIABLES, *(item.name for item in library.goal_variables(library[step.top]))}
    wrong = set(step.open) - known - {EVERYTHING}
    require(not wrong, f"{where}: open", f"some of {sorted(known)}", sorted(wrong))


def _call(
    step: RoleStep,
    library: TopLibrary,
    objects: Mapping[str, ObjectState],
    origin: Pose,
) -> TopCall:
    top = library[step.top]
    pose = step.pose(objects, origin)
    if step.at and top.point is Point.AXLE:
        pose = _in_area(pose, library.robot)
    return TopCall(top, library.goal(top, pose), frozenset(step.open))


def _in_area(
    pose: Pose,
    robot: Robot,
) -> Pose:
    """Return the nearest pose at which the robot does not stick out of the area."""
    area = robot.scene.area
    half_length = max(area.length / 2 - robot.reach, 0.0)
    half_width = max(area.width / 2 - robot.reach, 0.0)
    x = min(max(pose.x, area.x - half_length), area.x + half_length)
    y = min(max(pose.y, area.y - half_width), area.y + half_width)
    return pose._replace(x=x, y=y)
