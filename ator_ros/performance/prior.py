"""How durations are assumed to depend on features before drives show it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ator_ros.bases.description import Robot
from ator_ros.bases.direct import DIRECT_VARIABLES, direct_table
from ator_ros.bases.interface import Driving
from ator_ros.performance.features import Feature

_TURN_BEND = math.pi / 18.0  # rad
# Shares by which true slopes differ from those of the fastest path, by unit: most servers drive at
# 0.7 to 1 of their limits, while thresholds of turns make slopes steep.
_SHARE = 0.3
_SHARES = {"rad": 2.0, "": 1.0}
_LEAST_DEVIATION = 0.05  # s per unit: what costs a base no time may cost its action server some
_OF_STOPS = ("stopg", "rests")  # features of an action that passes its goals
_LONG = 10.0  # s at the greatest speed: drives in which the robot mostly has that speed


class Slope(NamedTuple):
    """How durations are assumed to depend on a feature.

    Attributes
    ----------
    time : float
        By how many s a drive takes longer per unit of the feature.
    deviation : float
        Standard deviation of the true slope about it, in the same unit.
    bend : float
        Along which distance of the feature, in its unit, the true slope is the same; 0: along all
        of it.
    """

    time: float
    deviation: float
    bend: float = 0.0


def prior_slopes(
    features: Sequence[Feature], robot: Robot, driving: Driving | None
) -> dict[str, Slope]:
    """Return how durations are assumed to depend on features, by name.

    It depends on the feature's unit only. Along lengths and angles they grow as the time of the
    fastest path does, as the action was observed to drive; None: at all limits of the base. A turn
    takes no less than one on the spot, since few servers turn while they drive. Along velocities
    durations grow by the time that the base needs to reach them. A feature in s counts as the time;
    one without a unit is a kind of drive, which may take longer by a turn to the back. A stop, or a
    start at rest, costs half the time in which the base loses, or gains, its greatest speed.
    """
    per_unit = {"s": 1.0, **_of_paths(robot, driving)}
    per_unit[""] = math.pi * per_unit["rad"]
    for axis in robot.axes:
        per_unit[axis.unit] = max(per_unit.get(axis.unit, 0.0), 1.0 / axis.rate)
    slopes = {}
    for feature in features:
        time = per_unit.get(feature.unit, 1.0)
        if feature.name in _OF_STOPS:
            time = 0.5 * robot.greatest_speed() * per_unit["m/s"]
        deviation = max(_SHARES.get(feature.unit, _SHARE) * time, _LEAST_DEVIATION)
        bend = _TURN_BEND if feature.unit == "rad" else 0.0
        slopes[feature.name] = Slope(time, deviation, bend)
    return slopes


def _of_paths(robot: Robot, driving: Driving | None) -> dict[str, float]:
    """Return the slopes of the times of fastest paths, by unit."""
    length = _LONG * robot.greatest_speed()
    angle = math.pi / 2.0
    rows = dict.fromkeys(DIRECT_VARIABLES, np.zeros(3))
    rows["xg"] = length * np.array([1.0, 2.0, 1.0])
    rows["yawg"] = np.array([0.0, 0.0, angle])
    short, long, turned = robot.fastest(direct_table(rows).table, driving)[0].tolist()
    turns = np.array([0.0, angle])
    nothing = np.zeros(2)
    on_route = robot.route_time(nothing + length, (nothing, nothing, turns), nothing, nothing)
    turn = max(turned - short, float(np.diff(on_route)[0]))
    return {"m": (long - short) / length, "rad": turn / angle}
