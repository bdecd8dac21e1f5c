"""Durations of turns and straight drives follow from their limits."""

import numpy as np
import pytest
from robots import OTHERS, PIONEER

from ator_ros.bases.description import Robot
from ator_ros.bases.differential import durations
from ator_ros.bases.differential.limits import Limits
from ator_ros.geometry import FloatArray

every_robot = pytest.mark.parametrize("robot", [PIONEER, OTHERS[-1]], ids=lambda robot: robot.name)


def drawn_drives(limits: Limits) -> FloatArray:
    """Return distances in m and speeds in m/s at both ends, shape (300, 3)."""
    return np.random.default_rng(3).uniform(-1.0, 1.0, (300, 3)) * (3.0, limits.v, limits.v)


@every_robot
def test_turns_have_the_duration_of_their_rate(robot: Robot) -> None:
    limits, angles = robot.limits, np.linspace(-5.0, 5.0, 101)
    times = durations.turn_time(angles, limits.w, limits.aw)
    size = np.abs(angles)
    ramped = size <= limits.w**2 / limits.aw
    expected = np.where(
        ramped, 2.0 * np.sqrt(size / limits.aw), size / limits.w + limits.w / limits.aw
    )
    assert times == pytest.approx(expected, abs=1e-12)
    assert [
        durations.turn_time(float(angle), limits.w, limits.aw) for angle in angles
    ] == times.tolist()
    gaining, steady = durations.turn_parts(angles, limits.w, limits.aw)
    rate = limits.aw * gaining
    assert rate * (gaining + steady) == pytest.approx(size, abs=1e-12)
    assert max(rate) <= limits.w + 1e-12


@pytest.mark.parametrize(("a", "brake"), [(0.25, 0.3), (0.8, 0.8), (0.9, 0.4)])
def test_drives_respect_the_accelerations_and_cover_the_distance(a: float, brake: float) -> None:
    limits = Limits(v=1.2, w=1.5, a=a, brake=brake, aw=1.3)
    for distance, before, after in drawn_drives(limits).tolist():
        gaining, steady, losing, top = durations.drive_parts(distance, before, after, limits)
        covered = steady * top
        for duration, start, end in ((gaining, before, top), (losing, top, after)):
            faster = abs(end) > abs(start)
            bound = min(a, brake) if start * end < 0.0 else a if faster else brake
            assert abs(end - start) <= bound * duration + 1e-9
            covered += duration * (start + end) / 2.0
        assert covered == pytest.approx(distance, abs=1e-9)


def test_drives_have_the_same_parts_one_by_one_and_as_arrays() -> None:
    limits = Limits(v=1.2, w=1.5, a=0.9, brake=0.4, aw=1.3)
    drives = drawn_drives(limits)
    parts = np.array(durations.drive_parts(*drives.T, limits)).T
    assert [durations.drive_parts(*drive, limits) for drive in drives.tolist()] == [
        *map(tuple, parts.tolist())
    ]
