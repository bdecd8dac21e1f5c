"""Durations and displacements for plans and for ideal times come from one physics: they agree to rounding."""

from __future__ import annotations

import numpy as np
import pytest
from robots import OTHERS, PIONEER

from ator_ros.motion import compiled_manoeuvre, durations, profiles
from ator_ros.motion.displacements import TurnDriving, displacements
from ator_ros.motion.turn_tables import EDGE, FINE, STEP, Way, turn_tables
from ator_ros.robot.description import Robot

every_robot = pytest.mark.parametrize("robot", [PIONEER, *OTHERS], ids=lambda robot: robot.name)


@every_robot
def test_turns_take_the_same_time(robot: Robot) -> None:
    limits, angles = robot.limits, np.linspace(0.0, 5.0, 101)
    planned = profiles.turn_times(angles, limits.w, limits.aw)
    assert durations.turn_time(angles, limits.w, limits.aw) == pytest.approx(planned, abs=1e-12)
    compiled = [compiled_manoeuvre.turn_time(angle, limits.w, limits.aw) for angle in angles]
    assert compiled == planned.tolist()  # both plan: a search in one must find what the other executes


@every_robot
def test_straight_drives_take_the_same_time(robot: Robot) -> None:
    limits, rng = robot.holder_for("a test").limits, np.random.default_rng(3)
    distance = rng.uniform(-3.0, 3.0, 300)
    before, after = rng.uniform(-limits.v, limits.v, (2, 300))
    planned = profiles.straight_times(distance, before, after, limits)
    rates = durations.rates_of(limits)
    assert durations.drive_time(distance, before, after, rates) == pytest.approx(planned, abs=1e-9)
    change = profiles.speed_change_distances(before, after, limits)
    assert durations.change_distance(before, after, rates) == pytest.approx(change, abs=1e-12)


@every_robot
def test_compiled_plans_have_the_same_pieces_to_the_last_bit(robot: Robot) -> None:
    limits, rng = robot.limits, np.random.default_rng(4)
    bounds = compiled_manoeuvre.Bounds(limits.v, limits.a, limits.brake, limits.aw)
    for distance, before, after in rng.uniform(-1.0, 1.0, (300, 3)) * (3.0, limits.v, limits.v):
        pieces = np.zeros((3, 3))
        compiled_manoeuvre._straight(pieces, 0, distance, before, after, bounds)
        planned = profiles.straight_pieces(distance, before, after, limits)
        assert pieces.tolist() == [list(piece) for piece in planned]


@every_robot
def test_turns_lead_to_the_same_place(robot: Robot) -> None:
    limits = robot.limits
    turn = TurnDriving(-limits.v, limits.a, limits.w)  # the first row of a table is that of the lowest speed
    tables = turn_tables(limits, (Way(turn.acceleration, turn.turn_rate),))
    bounds = compiled_manoeuvre.Bounds(limits.v, limits.a, limits.brake, limits.aw)
    side = np.array([0.0, turn.speed, *turn])
    for entry in range(0, EDGE, FINE // 2):
        angle = entry * STEP / FINE
        x, y = displacements(np.array([angle]), turn, limits)[:, 0]
        assert compiled_manoeuvre.displacement(angle, side, bounds) == pytest.approx((x, y), abs=1e-9)
        cos, sin = np.cos(angle), np.sin(angle)
        looked_up = tables.along[EDGE + entry], tables.across[EDGE + entry]
        assert looked_up == pytest.approx((cos * x + sin * y, cos * y - sin * x), abs=1e-9)
