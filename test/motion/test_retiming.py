"""A planned motion on a base that is weaker than it was planned for: the same way, at other times."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from candidates import candidates_between

from ator_ros.domains.soccer.planned.planner import free_sides
from ator_ros.geometry import FloatArray, Pose
from ator_ros.motion.manoeuvre import closed
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
def test_a_base_that_is_as_strong_as_planned_takes_no_longer(v: FloatArray, w: FloatArray) -> None:
    rates = greatest_rates(v, w, np.full(len(v) - 1, _STEP), LIMITS)
    assert rates == pytest.approx(1.0)


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


def test_a_base_slows_down_before_it_has_to_turn_less() -> None:
    """At full speed it could not lose its turn rate in time: so it turns, and drives, more slowly before."""
    v = ramps((0.0, 1.2), (2.0, 1.2))
    w = ramps((0.0, 0.0), (0.5, 0.0), (0.6, 0.2), (1.4, 0.2), (1.5, 0.0), (2.0, 0.0))
    hard = dataclasses.replace(LIMITS, aw=1.0)
    rates = greatest_rates(v, w, np.full(len(v) - 1, _STEP), hard)
    assert rates.min() == pytest.approx(math.sqrt(0.5), abs=0.01)
    assert rates[0] > 0.9
    assert np.abs(np.diff(rates * v) / times(rates)).max() < LIMITS.brake + 1e-6


def plan() -> Trajectory:
    """Return the fastest way to a pose behind, on the left."""
    sides = free_sides(LIMITS, 0.0, 0.0)
    candidates = candidates_between(Pose(0.0, 0.0, 0.0), Pose(-1.0, 1.5, 1.0), sides, sides, LIMITS)
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


def test_the_velocities_of_the_rest_are_those_of_its_poses() -> None:
    rest, short = plan().rest(0.4, WEAK), 0.02
    for time in np.arange(0.1, rest.duration - 0.1, 0.05):
        before, at, after = (rest.at(time + late) for late in (-short, 0.0, short))
        assert before.pose.distance(after.pose) / (2.0 * short) == pytest.approx(abs(at.v), abs=0.03)
        assert before.pose.relative(after.pose).yaw / (2.0 * short) == pytest.approx(at.w, abs=0.1)
