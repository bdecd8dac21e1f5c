"""Features: derived variables that correlate better with performance than the direct ones (paper, section 3).

One function, `feature_table`, serves learning and prediction. A feature is computed only if asked for.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from ator_ros.geometry import FloatArray, wrap_angles
from ator_ros.performance.direct import Direct, direct_arrays
from ator_ros.performance.durations import drive_time, turn_time
from ator_ros.performance.families import Family, approach_family, dribble_family, drive_family, shot_family
from ator_ros.performance.ideal_times import Ends, Motions, fastest_motions
from ator_ros.robot import Robot

Mirror = Literal["even", "odd"]
RELEASE = 0.33  # m before the goal at which a ball is let go
# Ways to shoot: where into the goal's mouth, in shares of its width from the middle, and in which direction.
_AIMS, _SHOTS = np.array(list(itertools.product((-0.2, 0.0, 0.2), (-0.6, 0.0, 0.6)))).T[:, :, None]


class Geometry:
    """The derived quantities of n situations, each computed once, when first asked for.

    Parameters
    ----------
    direct : mapping
        Direct variables, see `direct_arrays`.
    robot : Robot
        Limits, and where a ball is held.
    """

    def __init__(self, direct: Direct, robot: Robot) -> None:
        self.direct = direct_arrays(direct)
        self.robot = robot

    @cached_property
    def destination(self) -> tuple[FloatArray, FloatArray]:
        """Where the axle shall come, in m: behind the ball where the goal is that of a held ball."""
        d = self.direct
        back = self.robot.hold * d["hold"]
        return d["xg"] - back * np.cos(d["yawg"]), d["yg"] - back * np.sin(d["yawg"])

    @cached_property
    def dx(self) -> FloatArray:
        """From start to destination along x in m."""
        return self.destination[0] - self.direct["x"]

    @cached_property
    def dy(self) -> FloatArray:
        """From start to destination along y in m."""
        return self.destination[1] - self.direct["y"]

    @cached_property
    def dist(self) -> FloatArray:
        """Distance from start to destination in m."""
        return np.asarray(np.sqrt(self.dx * self.dx + self.dy * self.dy))

    @cached_property
    def _bearing(self) -> FloatArray:
        return np.arctan2(self.dy, self.dx)

    @cached_property
    def to_dest(self) -> FloatArray:
        """Signed angle in rad from the heading to the destination's bearing."""
        return wrap_angles(self._bearing - self.direct["yaw"])

    @cached_property
    def at_dest(self) -> FloatArray:
        """Signed angle in rad from the destination's bearing to the heading there."""
        return wrap_angles(self.direct["yawg"] - self._bearing)

    @cached_property
    def turn(self) -> FloatArray:
        """Signed angle in rad from the heading at the start to that at the destination."""
        return wrap_angles(self.direct["yawg"] - self.direct["yaw"])

    @cached_property
    def side(self) -> FloatArray:
        """1 where the destination lies to the left, else -1."""
        return np.where(self.to_dest >= 0.0, 1.0, -1.0)

    @cached_property
    def _opening(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Pose (m, m, rad) and time (s) at which the rotation of the start is lost, at constant speed."""
        d, aw = self.direct, self.robot.limits.aw
        time = np.abs(d["w"]) * (1.0 / aw)
        half = 0.5 * d["w"] * time
        heading = d["yaw"] + (2.0 / 3.0) * half  # in the mean
        way = d["v"] * time
        return d["x"] + way * np.cos(heading), d["y"] + way * np.sin(heading), d["yaw"] + half, time

    def _motions(
        self, family: Family, x: FloatArray, y: FloatArray, heading: FloatArray, speed: FloatArray
    ) -> Motions:
        """Give the fastest motions to the fastest of m destinations, shape (m, n), and speeds there (m/s)."""
        from_x, from_y, yaw, opening = self._opening
        dx, dy = x - from_x, y - from_y
        cos, sin = np.cos(yaw), np.sin(yaw)
        turn = wrap_angles(heading - yaw)
        columns = (cos * dx + sin * dy, cos * dy - sin * dx, turn, self.direct["v"], speed)
        ends = Ends(*(column.ravel() for column in np.broadcast_arrays(*columns)))
        return fastest_motions(ends, family, hold=self.robot.hold).best_of(len(opening)).after(opening)

    def _to_goal(self, family: Family) -> Motions:
        return self._motions(family, *self.destination, self.direct["yawg"], self.direct["speedg"])

    @cached_property
    def drive(self) -> Motions:
        """The fastest ideal motion without the ball, or up to it where the goal is to hold one."""
        holding = self.direct["hold"] > 0.5
        if holding.all():
            return self._to_goal(approach_family(self.robot))
        plain = self._to_goal(drive_family(self.robot))
        if not holding.any():
            return plain
        approach = self._to_goal(approach_family(self.robot))
        return Motions(
            np.where(holding, approach.time, plain.time), np.where(holding, approach.turn, plain.turn)
        )

    @cached_property
    def dribble(self) -> Motions:
        """The fastest ideal motion with the ball."""
        return self._to_goal(dribble_family(self.robot))

    def turn_drive_turn(self, *, reverse: bool = False) -> FloatArray:
        """Give the time in s of turning on the spot, driving, and turning again."""
        first, last = np.abs(self.to_dest), np.abs(self.at_dest)
        if reverse:
            first, last = np.pi - first, np.pi - last
        limits = self.robot.limits
        rest = np.zeros_like(self.dist)
        driving = drive_time(self.dist, rest, self.direct["speedg"], limits)
        return turn_time(first, limits.w, limits.aw) + driving + turn_time(last, limits.w, limits.aw)

    @cached_property
    def _from_hold(self) -> tuple[FloatArray, FloatArray]:
        d, hold = self.direct, self.robot.hold
        dx = d["xg"] - d["x"] - hold * np.cos(d["yaw"])
        dy = d["yg"] - d["y"] - hold * np.sin(d["yaw"])
        return dx, dy

    @cached_property
    def hold_dist(self) -> FloatArray:
        """Distance in m from the hold at the start to the goal's position."""
        dx, dy = self._from_hold
        return np.asarray(np.sqrt(dx * dx + dy * dy))

    @cached_property
    def hold_bearing(self) -> FloatArray:
        """Bearing in rad, in the world, of the goal's position seen from the hold at the start."""
        dx, dy = self._from_hold
        return np.arctan2(dy, dx)

    @cached_property
    def shot(self) -> Motions:
        """The fastest ideal motion with the ball to a run, at full speed, into the goal's mouth."""
        d, width = self.direct, self.robot.field.goal_width
        back = RELEASE + self.robot.hold
        heading = np.where(d["xg"] > 0.0, 0.0, np.pi) + _SHOTS
        x = d["xg"] - back * np.cos(heading)
        y = d["yg"] + width * _AIMS - back * np.sin(heading)
        return self._motions(shot_family(self.robot), x, y, heading, self.robot.dribble_limits.v + 0.0 * x)


@dataclass(frozen=True)
class Feature:
    """One derived variable.

    Attributes
    ----------
    name, unit : str
        SI units; angles in rad.
    derives : frozenset of str
        The direct variables that it is computed from (paper, section 4.2).
    compute : callable
        Gives its values, shape (n,).
    translation, rotation : bool
        Whether it stays the same when the world is moved or turned.
    mirror : {"even", "odd"}
        Whether it keeps its value or changes its sign when the world is mirrored at the x axis.
    """

    name: str
    unit: str
    derives: frozenset[str]
    compute: Callable[[Geometry], FloatArray]
    translation: bool = True
    rotation: bool = True
    mirror: Mirror = "even"


def _of(words: str) -> frozenset[str]:
    return frozenset(words.split())


def _raw(name: str, unit: str, mirror: Mirror) -> Feature:
    still = name in ("yaw", "yawg")
    return Feature(name, unit, _of(name), lambda g: g.direct[name], still, False, mirror)


_PLACES = _of("x y xg yg yawg hold")
_POSES = _PLACES | {"yaw"}
_MOTION = _POSES | {"v", "w", "speedg"}
_SHOT = _of("x y yaw xg yg")

PAPER_11 = (
    _raw("x", "m", "even"),
    _raw("y", "m", "odd"),
    _raw("yaw", "rad", "odd"),
    _raw("xg", "m", "even"),
    _raw("yg", "m", "odd"),
    _raw("yawg", "rad", "odd"),
    Feature("dx", "m", _of("x xg yawg hold"), lambda g: g.dx, rotation=False),
    Feature("dy", "m", _of("y yg yawg hold"), lambda g: g.dy, rotation=False, mirror="odd"),
    Feature("dist", "m", _PLACES, lambda g: g.dist),
    Feature("angle_to_dest", "rad", _POSES, lambda g: np.abs(g.to_dest)),
    Feature("angle_at_dest", "rad", _PLACES, lambda g: np.abs(g.at_dest)),
)
"""The candidates of the paper; its angles don't tell left from right."""

PAPER_3 = PAPER_11[-3:]
"""Those that the paper's model trees chose."""

SIGNED = (
    Feature("angle_at_dest_by_turn", "rad", _POSES, lambda g: g.side * g.at_dest),
    Feature("angle_between", "rad", _of("yaw yawg"), lambda g: np.abs(g.turn)),
    Feature("v", "m/s", _of("v"), lambda g: g.direct["v"]),
    Feature("w_by_turn", "rad/s", _POSES | {"w"}, lambda g: g.side * g.direct["w"]),
    Feature("speedg", "m/s", _of("speedg"), lambda g: g.direct["speedg"]),
    Feature("hold", "", _of("hold"), lambda g: g.direct["hold"]),
)
"""Angles and turn rate relative to the side of the first turn, velocities, and the kind of goal."""

IDEAL = (
    Feature("turn_drive_turn", "s", _POSES | {"speedg"}, lambda g: g.turn_drive_turn()),
    Feature("reverse_turn_drive_turn", "s", _POSES | {"speedg"}, lambda g: g.turn_drive_turn(reverse=True)),
    Feature("drive_time", "s", _MOTION, lambda g: g.drive.time),
    Feature("drive_turn", "rad", _MOTION, lambda g: g.drive.turn),
    Feature("dribble_time", "s", _MOTION, lambda g: g.dribble.time),
    Feature("dribble_turn", "rad", _MOTION, lambda g: g.dribble.turn),
)
"""Ideal times at the robot's limits, and the angles turned on the way."""

SHOT = (
    Feature("hold_dist", "m", _SHOT, lambda g: g.hold_dist),
    Feature("hold_angle", "rad", _SHOT, lambda g: np.abs(wrap_angles(g.hold_bearing - g.direct["yaw"]))),
    Feature("shot_time", "s", _SHOT | {"v", "w"}, lambda g: g.shot.time, translation=False, rotation=False),
    Feature("hold_off_axis", "rad", _SHOT, lambda g: np.abs(g.hold_bearing), rotation=False),
    Feature(
        "heading_off_axis", "rad", _of("yaw"), lambda g: np.abs(wrap_angles(g.direct["yaw"])), rotation=False
    ),
)
"""Of a ball that is held and a goal whose heading doesn't matter, on the field's x axis."""

FEATURES: dict[str, Feature] = {feature.name: feature for feature in (*PAPER_11, *SIGNED, *IDEAL, *SHOT)}
"""All features by name; a new one is a new row."""


def names_of(features: Iterable[Feature]) -> tuple[str, ...]:
    """Give the names of `features`."""
    return tuple(feature.name for feature in features)


def feature_table(direct: Direct, robot: Robot, names: Sequence[str]) -> FloatArray:
    """Compute features.

    Parameters
    ----------
    direct : mapping
        Direct variables of n situations, see `direct_arrays`.
    robot : Robot
        Limits, and where a ball is held.
    names : sequence of str
        Which features.

    Returns
    -------
    ndarray, shape (n, len(names))
    """
    geometry = Geometry(direct, robot)
    return table_of(geometry, names)


def table_of(geometry: Geometry, names: Sequence[str]) -> FloatArray:
    """Compute the features `names` of a geometry that others may have been computed of, shape (n, k)."""
    table = np.empty((len(geometry.direct["x"]), len(names)))
    for column, name in enumerate(names):
        table[:, column] = FEATURES[name].compute(geometry)
    return table


def derived_from(names: Iterable[str]) -> frozenset[str]:
    """Give the direct variables that the features `names` derive from (paper, section 4.2)."""
    return frozenset().union(*(FEATURES[name].derives for name in names))
