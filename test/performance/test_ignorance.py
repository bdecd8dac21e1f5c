"""What models predict where they were not trained: slopes of fastest paths, and their spread."""

import math

import numpy as np
import pandas as pd
import pytest
from experience_rows import dead_zone_drives, dead_zone_time

from ator_ros.actions.base import Goal
from ator_ros.domains.domain import find_domain
from ator_ros.geometry import FloatArray, Pose
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.training import direct_of, train
from ator_ros.refinement.gate import Gate
from ator_ros.refinement.refiner import Refinement, Refiner
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.world.state import CONTROL_PERIOD, RobotState, World

TOUR = find_domain("tour")
ROBOT = TOUR.robot()
ACTION = "drive_to"


def timed(rows: pd.DataFrame, noise: float = 0.05) -> pd.DataFrame:
    errors = np.random.default_rng(3).normal(0.0, noise, len(rows))
    duration = dead_zone_time(rows) + errors
    return rows.assign(time_to_go=duration, duration=duration)


def straight_drives(count: int, length: float | None = None) -> pd.DataFrame:
    """Return drives that depart and arrive straight, all of the same length (m) if it is given."""
    rows = dead_zone_drives(count, seed=1)
    bearing = np.arctan2(rows["yg"] - rows["y"], rows["xg"] - rows["x"])
    rows = rows.assign(yaw=bearing, yawg=bearing)
    if length is not None:
        rows["xg"] = rows["x"] + length * np.cos(bearing)
        rows["yg"] = rows["y"] + length * np.sin(bearing)
    return timed(rows)


def predicted(model: PerformanceModel, length: float, arrival: float = 0.0) -> FloatArray:
    """Return duration and spread (s) of a drive over a length (m) that ends turned (rad)."""
    there = dict.fromkeys(("x", "y", "yaw", "v", "w", "speedg", "hold"), 0.0)
    direct = {**there, "xg": length, "yg": 0.0, "yawg": arrival}
    found = model.predict(direct, ("duration", "spread"))
    assert found.duration is not None
    assert found.spread is not None
    return np.append(found.duration, found.spread)


def test_after_short_drives_a_long_one_takes_as_long_as_its_path() -> None:
    model = train(ACTION, straight_drives(40, length=1.0), ROBOT)
    for length in (30.0, 300.0):
        duration, spread = predicted(model, length)
        path = length / ROBOT.greatest_speed()
        assert duration == pytest.approx(path, rel=0.2)
        assert 0.1 * path < spread < 0.6 * path
        assert abs(duration - length / 0.6) < 2.0 * spread  # what the law says


def test_no_spread_is_below_the_resolution_of_durations() -> None:
    rows = straight_drives(1, length=2.0)
    same = pd.concat([rows.assign(episode=number) for number in range(30)], ignore_index=True)
    _, spread = predicted(train(ACTION, same, ROBOT), 2.0)
    assert spread >= CONTROL_PERIOD / math.sqrt(12.0)


def turned(model: PerformanceModel) -> Refinement:
    """Refine the first heading of two drives with a turn of 70° between them."""
    visit = TOUR.library(ROBOT)["visit"]
    corner = Pose(2.0, 0.0, 0.0)
    end = corner.compose(Pose(0.0, 0.0, math.radians(70.0))).compose(Pose(2.0, 0.0, 0.0))
    calls = (TopCall(visit, Goal(corner), frozenset({"yaw"})), TopCall(visit, Goal(end)))
    world = World(0.0, RobotState(Pose(0.0, 0.0, 0.0)))
    refiner = Refiner(ROBOT, {ACTION: model}, Gate())
    return refiner.refine(world, TopChain(calls), placeholders=True)


def test_a_turn_is_not_moved_to_where_no_drive_shows_what_it_costs() -> None:
    found = turned(train(ACTION, straight_drives(40), ROBOT))
    assert not found.refined
    assert found.gain <= found.uncertainty
    if found.gain > CONTROL_PERIOD:
        assert "no drive varied" in found.reason


def test_drives_in_all_directions_make_the_same_choice_certain() -> None:
    model = train(ACTION, timed(dead_zone_drives(200, seed=2)), ROBOT)
    assert model.not_varied == ()
    known = direct_of(dead_zone_drives(50, seed=8))
    spread = model.predict(known, ("spread",)).spread
    assert spread is not None
    assert np.median(spread) < 0.25
