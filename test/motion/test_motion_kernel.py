"""Durations come from one place: compiled code, arrays and numbers agree to the last bit."""

from __future__ import annotations

import numpy as np
import pytest
from robots import OTHERS, PIONEER

from ator_ros.compiled import compiled
from ator_ros.geometry import FloatArray
from ator_ros.motion import compiled_manoeuvre, durations
from ator_ros.motion.displacements import TurnDriving, displacements
from ator_ros.motion.durations import Rates, rates_of
from ator_ros.motion.turn_tables import EDGE, FINE, STEP, Way, turn_tables
from ator_ros.robot.description import Limits, Robot

every_robot = pytest.mark.parametrize("robot", [PIONEER, *OTHERS], ids=lambda robot: robot.name)


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
def test_turns_take_as_long_as_their_rate_says(robot: Robot) -> None:
    limits, angles = robot.limits, np.linspace(-5.0, 5.0, 101)
    times, result = durations.turn_time(angles, limits.w, limits.aw), np.empty(101)
    size = np.abs(angles)
    ramped = size <= limits.w**2 / limits.aw
    expected = np.where(ramped, 2.0 * np.sqrt(size / limits.aw), size / limits.w + limits.w / limits.aw)
    assert times == pytest.approx(expected, abs=1e-12)
    compiled_turns(angles, rates_of(limits), result)
    assert result.tolist() == times.tolist()
    assert [durations.turn_time(float(angle), limits.w, limits.aw) for angle in angles] == times.tolist()
    for angle, time in zip(angles.tolist(), times.tolist(), strict=True):
        pieces = durations.turn_pieces(angle, limits.w, limits.aw)
        assert sum(piece.duration for piece in pieces) == pytest.approx(time, abs=1e-12)
        assert sum(p.duration * (p.start + p.end) / 2.0 for p in pieces) == pytest.approx(angle, abs=1e-12)
        assert max(abs(piece.end) for piece in pieces) <= limits.w + 1e-12


@every_robot
def test_straight_drives_take_the_same_time_in_every_form(robot: Robot) -> None:
    limits = robot.holder_for("a test").limits
    drives, result = drawn_drives(limits), np.empty(300)
    times = durations.drive_time(*drives.T, limits)
    compiled_drives(drives, rates_of(limits), result)
    assert result.tolist() == times.tolist()
    pieces = [durations.straight_pieces(*drive, limits) for drive in drives.tolist()]
    assert [sum(piece.duration for piece in each) for each in pieces] == pytest.approx(times, abs=1e-12)


@every_robot
def test_changes_of_speed_go_at_the_limits(robot: Robot) -> None:
    limits = robot.limits
    slower = min(limits.a, limits.brake)
    for before, after, rate in (
        (0.1, 0.5, limits.a),
        (0.5, 0.1, limits.brake),
        (-0.1, -0.5, limits.a),
        (-0.5, -0.1, limits.brake),
        (-0.3, 0.5, slower),
        (0.3, -0.5, slower),
    ):
        time, way = abs(after - before) / rate, (after**2 - before**2) / (2.0 * rate)
        assert durations.change_time(before, after, limits) == pytest.approx(time, abs=1e-12)
        assert durations.change_distance(before, after, limits) == pytest.approx(
            np.copysign(way, before + after), abs=1e-12
        )


@pytest.mark.parametrize(("a", "brake"), [(0.25, 0.3), (0.8, 0.8), (0.9, 0.4)])
def test_drives_gain_and_lose_speed_no_faster_than_the_base_and_lead_all_the_way(
    a: float, brake: float
) -> None:
    """A change of speed that the drive is too short for was planned as one that brakes beyond standing."""
    limits = Limits(v=1.2, w=1.5, a=a, brake=brake, aw=1.3)
    for distance, before, after in drawn_drives(limits).tolist():
        pieces = durations.straight_pieces(distance, before, after, limits)
        for duration, start, end in pieces:
            faster = abs(end) > abs(start)
            bound = min(a, brake) if start * end < 0.0 else a if faster else brake
            assert abs(end - start) <= bound * duration + 1e-9
        way = sum(piece.duration * (piece.start + piece.end) / 2.0 for piece in pieces)
        assert way == pytest.approx(distance, abs=1e-9)


@every_robot
def test_compiled_plans_have_the_same_pieces_to_the_last_bit(robot: Robot) -> None:
    limits, rates = robot.limits, rates_of(robot.limits)
    for distance, before, after in drawn_drives(limits).tolist():
        pieces = np.zeros((3, 3))
        compiled_manoeuvre._straight(pieces, 0, distance, before, after, rates)
        planned = durations.straight_pieces(distance, before, after, limits)
        assert pieces.tolist() == [list(piece) for piece in planned]
        compiled_manoeuvre._turn(pieces, 0, distance, limits.w, limits.aw)
        planned = durations.turn_pieces(distance, limits.w, limits.aw)
        assert pieces.tolist() == [list(piece) for piece in planned]


@every_robot
def test_turns_lead_to_the_same_place(robot: Robot) -> None:
    limits = robot.limits
    turn = TurnDriving(-limits.v, limits.a, limits.w)  # the first row of a table is that of the lowest speed
    tables = turn_tables(limits, (Way(turn.acceleration, turn.turn_rate),))
    side = np.array([0.0, turn.speed, *turn])
    for entry in range(0, EDGE, FINE // 2):
        angle = entry * STEP / FINE
        x, y = displacements(np.array([angle]), turn, limits)[:, 0]
        assert compiled_manoeuvre.displacement(angle, side, rates_of(limits)) == pytest.approx(
            (x, y), abs=1e-9
        )
        cos, sin = np.cos(angle), np.sin(angle)
        looked_up = tables.along[EDGE + entry], tables.across[EDGE + entry]
        assert looked_up == pytest.approx((cos * x + sin * y, cos * y - sin * x), abs=1e-9)
