"""A planned motion on a base that is weaker than it was planned for: the same way, at other times."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from ator_ros.domains.soccer.planned.planner import free_sides
from ator_ros.geometry import FloatArray, Pose
from ator_ros.motion.manoeuvre import closed
from ator_ros.motion.planning import Found, Planning
from ator_ros.motion.search import find_candidates, ways_to_drive
from ator_ros.motion.trajectory import Trajectory, greatest_rates
from ator_ros.robot.description import load_robot

LIMITS, SHARE = load_robot().limits, 0.7
WEAK = dataclasses.replace(LIMITS, a=SHARE * LIMITS.a, aw=SHARE * LIMITS.aw)
_STEP = 0.05


def ramps(*knots: tuple[float, float]) -> FloatArray:
    """Return speeds at every step of a profile, given times in s and speeds."""
    times, speeds = zip(*knots, strict=True)
    return np.interp(np.arange(0.0, times[-1] + _STEP / 2, _STEP), times, speeds)


STILL = ramps((0.0, 0.0), (4.0, 0.0))
DRIVE = ramps((0.0, 0.0), (1.5, 1.2), (2.5, 1.2), (4.0, 0.0))
TURN = ramps((0.0, 0.0), (1.0, 0.0), (1.6, 2.4), (2.0, 2.4), (2.6, 0.0), (4.0, 0.0))
SWING = ramps((0.0, 0.0), (0.5, 2.0), (1.5, -2.0), (2.0, 0.0), (4.0, 0.0))


def times(rates: FloatArray) -> FloatArray:
    """Return the times in s that the steps of a motion take."""
    return np.asarray(2.0 * _STEP / (rates[:-1] + rates[1:]))


MOTIONS = pytest.mark.parametrize(
    ("v", "w"), [(DRIVE, STILL), (-DRIVE, STILL), (STILL, TURN), (DRIVE, TURN), (-DRIVE, SWING)]
)


@MOTIONS
def test_a_weak_base_gets_what_it_can_do(v: FloatArray, w: FloatArray) -> None:
    """It is asked for all of its acceleration somewhere, nowhere for more, and takes little longer."""
    rates = greatest_rates(v, w, np.full(len(v) - 1, _STEP), WEAK)
    gains = np.diff(rates * np.abs(v)) / times(rates)
    turns = np.abs(np.diff(rates * w)) / times(rates)
    assert gains.max() < WEAK.a + 1e-6
    assert gains.min() > -WEAK.brake - 1e-6
    assert turns.max() < WEAK.aw + 1e-6
    assert max(gains.max() / WEAK.a, turns.max() / WEAK.aw) > 0.999
    planned = _STEP * len(times(rates))
    assert planned < times(rates).sum() < planned / math.sqrt(SHARE)


def result(planning: Planning[Found]) -> Found:
    """Return what a search finds."""
    try:
        while True:
            next(planning)
    except StopIteration as done:
        found: Found = done.value
        return found


def plan() -> Trajectory:
    """Return the fastest way to a pose behind, on the left."""
    sides = free_sides(LIMITS, 0.0, 0.0)
    ways = result(ways_to_drive(sides, sides, LIMITS))
    candidates = result(find_candidates(Pose(0.0, 0.0, 0.0), Pose(-1.0, 1.5, 1.0), ways))
    manoeuvre = closed(candidates[0])
    assert manoeuvre is not None
    return Trajectory(manoeuvre)


@pytest.mark.parametrize("since", [0.0, 0.33, 1.7])
def test_the_rest_of_a_trajectory_takes_the_same_way(since: float) -> None:
    whole = plan()
    rest = whole.rest(since, WEAK)
    assert rest.duration > whole.duration - since
    assert rest.at(0.0).pose == pytest.approx(whole.at(since).pose, abs=1e-6)
    assert rest.at(math.inf).pose == pytest.approx(whole.at(math.inf).pose, abs=1e-6)
    far = [min(math.dist(pose, other) for other in whole.poses()) for pose in rest.poses()]
    assert max(far) < 0.02
