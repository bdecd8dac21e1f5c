"""Durations from compiled code, arrays and numbers are bit-identical."""

from __future__ import annotations

import numpy as np
import pytest
from robots import OTHERS, PIONEER

from ator_ros.compiled import compiled
from ator_ros.geometry import FloatArray
from ator_ros.motion import durations
from ator_ros.motion.durations import Rates, rates_of
from ator_ros.robot.description import Limits, Robot

every_robot = pytest.mark.parametrize("robot", [PIONEER, OTHERS[-1]], ids=lambda robot: robot.name)


@compiled
def compiled_turns(angles: FloatArray, rates: Rates, result: FloatArray) -> None:
    for at in range(len(angles)):
        result[at] = durations.turn_time(angles[at], rates.w, rates.aw)


@compiled
def compiled_drives(drives: FloatArray, rates: Rates, result: FloatArray) -> None:
    for at in range(len(drives)):
        distance, before, after = drives[at, 0], drives[at, 1], drives[at, 2]
        result[at] = durations.drive_time(distance, before, after, rates)


def drawn_drives(limits: Limits) -> FloatArray:
    """Return distances in m and speeds in m/s at both ends, shape (300, 3)."""
    return np.random.default_rng(3).uniform(-1.0, 1.0, (300, 3)) * (3.0, limits.v, limits.v)


@every_robot
def test_turns_have_the_duration_of_their_rate(robot: Robot) -> None:
    limits, angles = robot.limits, np.linspace(-5.0, 5.0, 101)
    times, result = durations.turn_time(angles, limits.w, limits.aw), np.empty(101)
    size = np.abs(angles)
    ramped = size <= limits.w**2 / limits.aw
    expected = np.where(ramped, 2.0 * np.sqrt(size / limits.aw), size / limits.w + limits.w / limits.aw)
    assert times == pytest.approx(expected, abs=1e-12)
    compiled_turns(angles, rates_of(limits), result)
    assert result.tolist() == times.tolist()
    assert [durations.turn_time(float(angle), limits.w, limits.aw) for angle in angles] == times.tolist()
    gaining, steady = durations.turn_parts(angles, limits.w, limits.aw)
    rate = limits.aw * gaining
    assert rate * (gaining + steady) == pytest.approx(size, abs=1e-12)
    assert max(rate) <= limits.w + 1e-12


@every_robot
def test_straight_drives_take_the_same_time_in_every_form(robot: Robot) -> None:
    limits = robot.holder_for("a test").limits
    drives, result = drawn_drives(limits), np.empty(300)
    times = durations.drive_time(*drives.T, limits)
    compiled_drives(drives, rates_of(limits), result)
    assert result.tolist() == times.tolist()
    assert sum(durations.drive_parts(*drives.T, limits)[:3]) == pytest.approx(times, abs=1e-12)


@pytest.mark.parametrize(("a", "brake"), [(0.25, 0.3), (0.8, 0.8), (0.9, 0.4)])
def test_drives_respect_the_accelerations_and_cover_the_distance(a: float, brake: float) -> None:
    limits = Limits(v=1.2, w=1.5, a=a, brake=brake, aw=1.3)
    for distance, before, after in drawn_drives(limits).tolist():
        gaining, steady, losing, top = durations.drive_parts(distance, before, after, limits)
        way = steady * top
        for duration, start, end in ((gaining, before, top), (losing, top, after)):
            faster = abs(end) > abs(start)
            bound = min(a, brake) if start * end < 0.0 else a if faster else brake
            assert abs(end - start) <= bound * duration + 1e-9
            way += duration * (start + end) / 2.0
        assert way == pytest.approx(distance, abs=1e-9)
