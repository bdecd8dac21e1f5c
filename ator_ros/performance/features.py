"""Features: derived variables that correlate better with performance than the direct ones (paper, section 3).

One function, `feature_table`, serves learning and prediction. A feature is computed only if asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ator_ros.geometry import FloatArray, wrap_angles
from ator_ros.performance.derived import Geometry
from ator_ros.performance.direct import Direct
from ator_ros.performance.driving import DrivingStyle
from ator_ros.robot.description import Robot

Mirror = Literal["even", "odd"]


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
    Feature("hold_angle", "rad", _SHOT, lambda g: np.abs(g.hold_angle)),
    Feature("shot_time", "s", _SHOT | {"v", "w"}, lambda g: g.shot.time, translation=False, rotation=False),
    Feature("hold_off_axis", "rad", _SHOT, lambda g: np.abs(g.hold_bearing), rotation=False),
    Feature(
        "heading_off_axis", "rad", _of("yaw"), lambda g: np.abs(wrap_angles(g.direct["yaw"])), rotation=False
    ),
)
"""Of a ball that is held and a goal whose heading doesn't matter, on the field's x axis."""

PATHS = (
    Feature("path_time", "s", _MOTION, lambda g: g.path.time),
    Feature("path_turn", "rad", _MOTION, lambda g: g.path.turn),
)
"""Time of and angle turned on the fastest path at the limits that odometry showed."""

FEATURES: dict[str, Feature] = {
    feature.name: feature for feature in (*PAPER_11, *SIGNED, *IDEAL, *SHOT, *PATHS)
}
"""All features by name; a new one is a new row."""


def names_of(features: Iterable[Feature]) -> tuple[str, ...]:
    """Return the names of `features`."""
    return tuple(feature.name for feature in features)


def feature_table(
    direct: Direct, robot: Robot, names: Sequence[str], driving: DrivingStyle | None = None
) -> FloatArray:
    """Compute features.

    Parameters
    ----------
    direct : mapping
        Direct variables of n situations, see `direct_arrays`.
    robot : Robot
        Limits, and where a ball is held.
    names : sequence of str
        Which features.
    driving : DrivingStyle, optional
        How the action was observed to drive, for `PATHS`.

    Returns
    -------
    ndarray, shape (n, len(names))
    """
    geometry = Geometry(direct, robot, driving)
    return table_of(geometry, names)


def table_of(geometry: Geometry, names: Sequence[str]) -> FloatArray:
    """Compute the features `names` of a geometry that others may have been computed of, shape (n, k)."""
    table = np.empty((len(geometry.direct["x"]), len(names)))
    for column, name in enumerate(names):
        if name not in geometry.features:
            geometry.features[name] = FEATURES[name].compute(geometry)
        table[:, column] = geometry.features[name]
    return table


def derived_from(names: Iterable[str]) -> frozenset[str]:
    """Return the direct variables that the features `names` derive from (paper, section 4.2)."""
    return frozenset().union(*(FEATURES[name].derives for name in names))
