"""Features: derived variables that correlate better with performance than the direct ones.

See section 3 of the paper. The features here hold for any action of a robot that drives. A domain
adds its own, see `Domain.features`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, partial

import numpy as np

from ator_ros.actions.goal_variables import STOPS, GoalVariable, direct_name
from ator_ros.bases.description import Robot
from ator_ros.bases.direct import DIRECT_VARIABLES, Direct
from ator_ros.bases.interface import Driving
from ator_ros.bases.routes import routes_of
from ator_ros.geometry import FloatArray, wrap_angles
from ator_ros.performance.derived import (
    ANGLE_AT,
    ANGLE_TO,
    ARRIVAL,
    BASICS,
    DIST,
    FROM_X,
    FROM_Y,
    FROM_YAW,
    GOAL_YAW,
    PATH_TIME,
    PATH_TURN,
    SPEED,
    TO_X,
    TO_Y,
    Geometry,
)


@dataclass(frozen=True, eq=False)
class Feature:
    """One derived variable (paper, section 4.1).

    Attributes
    ----------
    name, unit : str
        Name, as in rules and model files, and SI unit; an empty unit for numbers without one.
    derives : frozenset of str
        The direct variables that it is computed from (paper, section 4.2).
    compute : callable
        Returns its values for the geometry of n situations, shape (n,), in SI units.
    row : int or None
        Its number among `Geometry.rows`; None: it is none of them.
    """

    name: str
    unit: str
    derives: frozenset[str]
    compute: Callable[[Geometry], FloatArray]
    row: int | None = None


def variables(words: str) -> frozenset[str]:
    """Return the names of the direct variables in a text, for `Feature.derives`."""
    return frozenset(words.split())


def _basic(name: str, unit: str, derives: str) -> Feature:
    """Return the feature that is one of the rows of `BASICS`."""
    row = BASICS.index(name)
    return Feature(
        name,
        unit,
        variables(derives),
        lambda g: g.rows[row],
        row,
    )


_PLACES = "x y xg yg yawg hold"
_POSES = f"{_PLACES} yaw"

_DIRECT = ("x", "y", "yaw", "xg", "yg", "yawg")
PAPER_11 = (
    *(_basic(name, DIRECT_VARIABLES[name], name) for name in _DIRECT),
    _basic("dx", "m", "x xg yawg hold"),
    _basic("dy", "m", "y yg yawg hold"),
    _basic("dist", "m", _PLACES),
    _basic("angle_to_dest", "rad", _POSES),
    _basic("angle_at_dest", "rad", _PLACES),
)
"""The candidates of the paper; its angles are the same to the left and to the right."""

PAPER_3 = PAPER_11[-3:]
"""Those that the paper's model trees chose."""

SIGNED = (
    _basic("angle_at_dest_by_turn", "rad", _POSES),
    _basic("angle_between", "rad", "yaw yawg"),
    _basic("v", "m/s", "v"),
    _basic("w_by_turn", "rad/s", f"{_POSES} w"),
    _basic("speedg", "m/s", "speedg"),
    _basic("hold", "", "hold"),
)
"""Angles and turn rate relative to the side of the first turn, velocities, and the kind of goal.

A positive angle continues the first turn, a negative one is opposite to it.
"""

LATERAL = (_basic("vy_by_turn", "m/s", f"{_POSES} vy"),)
"""The lateral velocity relative to the same side, of a base that moves sideways."""

_MOTION = variables(f"{_POSES} speedg v w")
PATHS = (
    Feature(
        "path_time",
        "s",
        _MOTION,
        lambda g: g.path[0],
        PATH_TIME,
    ),
    Feature(
        "path_turn",
        "rad",
        _MOTION,
        lambda g: g.path[1],
        PATH_TURN,
    ),
)
"""Time of, and angle turned on, the fastest path as the action was observed to drive.

See `Geometry.path`.
"""


def base_features(driving: type[Driving]) -> tuple[Feature, ...]:
    """Return the features that the base adds, for the class of what is learned of its driving.

    They are candidates of `ator_ros.performance.training.duration_features`.
    """
    return _of_base(tuple(driving.quantities.items()))


@cache
def _of_base(quantities: tuple[tuple[str, str], ...]) -> tuple[Feature, ...]:
    return tuple(
        Feature(name, unit, variables(_POSES), partial(_quantity, number))
        for number, (name, unit) in enumerate(quantities)
    )


def _quantity(number: int, geometry: Geometry) -> FloatArray:
    return np.asarray(geometry.quantities[number])


GENERAL: dict[str, Feature] = {each.name: each for each in (*PAPER_11, *SIGNED, *LATERAL, *PATHS)}
"""The features that every domain has, by name."""

CANDIDATES: tuple[Feature, ...] = (*PAPER_3, *SIGNED, *PATHS)
"""Candidate features of an action that names none; see `ActionSpec.features`."""


def suited(features: Sequence[Feature], robot: Robot) -> tuple[Feature, ...]:
    """Return features, with `LATERAL` where the velocity counts and the base moves sideways."""
    counts = robot.moves_sideways and GENERAL["v"] in features
    return tuple(dict.fromkeys((*features, *(LATERAL if counts else ()))))


def _on_route(geometry: Geometry) -> FloatArray:
    """Return the features of routes except their times, shape (5, n).

    Straight routes have the distance and angles of `PAPER_3`.
    """
    rows = geometry.rows
    routes = routes_of(geometry.robot)
    assert routes is not None
    route = routes.between(
        rows[FROM_X],
        rows[FROM_Y],
        rows[TO_X],
        rows[TO_Y],
    )
    to = np.abs(wrap_angles(route.departure - rows[FROM_YAW]))
    at = np.abs(wrap_angles(rows[GOAL_YAW] - route.arrival))
    length = np.where(route.straight, rows[DIST], route.length)
    to = np.where(route.straight, rows[ANGLE_TO], to)
    at = np.where(route.straight, rows[ANGLE_AT], at)
    return np.stack([length, route.turn, route.clearance, to, at])


def _route_time(geometry: Geometry) -> FloatArray:
    """Return the times of routes at the robot's limits, with turns on the spot at both ends."""
    length, turn, _, to, at = geometry.once(_on_route)
    rows = geometry.rows
    return geometry.robot.route_time(length, (to, turn, at), rows[SPEED], rows[ARRIVAL])


ROUTE_FEATURES = (
    ROUTE_LENGTH := Feature(
        "route_length", "m", variables(_PLACES), lambda g: g.once(_on_route)[0]
    ),
    Feature("route_turn", "rad", variables(_PLACES), lambda g: g.once(_on_route)[1]),
    Feature("route_clearance", "m", variables(_PLACES), lambda g: g.once(_on_route)[2]),
    ROUTE_ANGLE_TO := Feature(
        "route_angle_to", "rad", variables(_POSES), lambda g: g.once(_on_route)[3]
    ),
    ROUTE_ANGLE_AT := Feature(
        "route_angle_at", "rad", variables(_PLACES), lambda g: g.once(_on_route)[4]
    ),
    ROUTE_TIME := Feature("route_time", "s", _MOTION, _route_time),
)
"""The features of the routes on the robot's map."""


DRIVES_ON = 0.1
"""Speed in m/s above which a start counts as passing: a robot that stops may still roll slower."""


def _rests(geometry: Geometry) -> FloatArray:
    return np.where(np.abs(geometry.rows[SPEED]) <= DRIVES_ON, 1.0, 0.0)


def _moving_turn(geometry: Geometry) -> FloatArray:
    on_map = routes_of(geometry.robot) is not None
    turn = geometry.once(_on_route)[3] if on_map else geometry.rows[ANGLE_TO]
    return np.asarray(turn * (1.0 - geometry.once(_rests)))


def goal_feature(variable: GoalVariable) -> Feature:
    """Return a goal variable that an action declares as a feature: NAMEg, as in experience."""
    name = direct_name(variable.name)
    return Feature(
        name,
        variable.unit,
        frozenset({name}),
        lambda g: g.direct[name],
    )


PASSING_FEATURES = (
    goal_feature(STOPS),
    Feature("rests", "", variables("v"), _rests),
    Feature("moving_turn", "rad", variables(f"{_POSES} v"), _moving_turn),
)
"""The features of an action that passes its goals.

They are whether it stops there, whether it starts at rest (1 or 0), and the turn to the route at a
start that is no rest.
"""


def names_of(features: Iterable[Feature]) -> tuple[str, ...]:
    """Return the names of `features`."""
    return tuple(feature.name for feature in features)


def feature_table(
    direct: Direct,
    robot: Robot,
    features: Sequence[Feature],
    driving: Driving | None = None,
) -> FloatArray:
    """Return the features of n situations, shape (n, len(features)), in SI units.

    Parameters
    ----------
    direct : mapping
        Direct variables, see `direct_table`.
    robot : Robot
        The robot that drives.
    features : sequence of Feature
        The columns.
    driving : Driving, optional
        How the action was observed to drive, for `PATHS`; by default at all limits of the base.

    Raises
    ------
    ValueError
        A direct variable that a feature derives from is missing.
    """
    geometry = Geometry(direct, robot, driving, declared_by(features))
    table = np.empty((len(geometry.direct["x"]), len(features)))
    for column, feature in enumerate(features):
        table[:, column] = geometry.once(feature.compute)
    return table


def derived_from(features: Iterable[Feature]) -> frozenset[str]:
    """Return the direct variables that features derive from (paper, section 4.2)."""
    return frozenset().union(*(feature.derives for feature in features))


def declared_by(features: Iterable[Feature]) -> tuple[str, ...]:
    """Return the direct variables of `features` that are declared goal variables, sorted."""
    return tuple(sorted(derived_from(features) - DIRECT_VARIABLES.keys()))
