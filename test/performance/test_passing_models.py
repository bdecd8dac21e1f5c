"""Models of an action that passes its goals: what a stop costs, and what is unknown of it."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest
from experience_rows import synthetic_experience
from maps import hall_map

from ator_ros.actions.goal_variables import STOP, with_values
from ator_ros.domains.domain import find_domain
from ator_ros.geometry import Pose
from ator_ros.performance.features import feature_table
from ator_ros.performance.model import Passing, PerformanceModel
from ator_ros.performance.training import direct_of, train, without_errors
from ator_ros.refinement.refiner import Refiner
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.world.state import RobotState, World

DOMAIN = find_domain("patrol")
ROBOT = DOMAIN.robot()
STOP_TIME = 1.4
"""Time in s that a stop takes at each end."""


def legs(episodes: int, seed: int, *, passing: bool) -> pd.DataFrame:
    """Return legs, half of which begin, and half end, in passing, if any do."""
    rows = synthetic_experience("pursue", episodes=episodes, seed=seed)
    rng = np.random.default_rng(seed)
    moves, passes = (rng.random((2, episodes)) < 0.5) & passing
    dx, dy = rows["xg"] - rows["x"], rows["yg"] - rows["y"]
    rows["v"] = np.where(moves, 0.4, 0.0)
    rows["stopg"] = np.where(passes, 0.0, 1.0)
    stops = 2.0 - moves - passes
    rows["duration"] = 0.3 + 1.7 * np.hypot(dx, dy) + STOP_TIME * stops
    rows["time_to_go"], rows["success"] = rows["duration"], True
    rows["position_error"] = 0.1
    rows["nearer"] = np.where(passes, rng.uniform(0.2, 0.3, episodes), np.nan)
    rows["heading_error"] = np.where(passes, np.nan, 0.02)
    return rows


@cache
def learned(*, passing: bool) -> PerformanceModel:
    rows = legs(100, 1, passing=passing)
    return train("pursue", rows, ROBOT, features=DOMAIN.candidates("pursue"))


LEG = {"x": 0.0, "y": 0.0, "yaw": 0.0, "w": 0.0, "xg": 3.0, "yg": 0.5, "speedg": 0.0, "hold": 0.0}


def leg(
    model: PerformanceModel, *, v: float, stop: float, yawg: float = 0.0
) -> tuple[float, float]:
    """Return the predicted duration of a leg, and its standard deviation, in s."""
    direct = {**LEG, "v": v, "stopg": stop, "yawg": yawg}
    predicted = model.predict(direct, ("duration", "spread"))
    assert predicted.duration is not None
    assert predicted.spread is not None
    return float(predicted.duration[0]), float(predicted.spread[0])


def test_drives_of_both_kinds_show_what_stops_cost() -> None:
    model = learned(passing=True)
    assert model.passing == Passing(pytest.approx(0.2, abs=0.01), pytest.approx(0.4))
    assert model.arrival is not None
    assert model.arrival.dist == pytest.approx(0.1)
    slow, _ = leg(model, v=0.0, stop=1.0)
    fast, spread = leg(model, v=0.4, stop=0.0)
    assert slow - fast == pytest.approx(2.0 * STOP_TIME, abs=0.2)
    assert spread < 0.3
    fresh = legs(200, 2, passing=True)
    errors = fresh["duration"] - model.predict(direct_of(fresh)).duration
    assert np.abs(errors).mean() < 0.15


@pytest.mark.long
def test_slow_sharp_turns_at_passed_stations_are_learned_and_refinement_stops_there() -> None:
    rows = legs(100, 5, passing=True)
    features = DOMAIN.candidates("pursue")
    (moving_turn,) = (each for each in features if each.name == "moving_turn")
    (turns,) = feature_table(direct_of(rows), ROBOT, [moving_turn]).T
    slow = rows["duration"] + 6.0 * (turns > math.radians(120.0))
    model = train("pursue", rows.assign(duration=slow, time_to_go=slow), ROBOT, features=features)

    def duration(yaw: float) -> float:
        direct = {**LEG, "v": 0.4, "stopg": 1.0, "yaw": yaw, "yawg": 0.0}
        predicted = model.predict(direct).duration
        assert predicted is not None
        return float(predicted[0])

    assert duration(3.1) > duration(1.0) + 2.0 * STOP_TIME

    library = DOMAIN.library(ROBOT)
    visit = library["visit"]
    refiner = Refiner(ROBOT, {"pursue": model}, ranges=library.ranges)
    start = World(0.0, RobotState(Pose(0.0, 0.0, 0.0)))

    def first_stop(second_x: float) -> float:
        places = (Pose(2.0, 0.0, 0.0), Pose(second_x, 0.5, 0.0))
        goals = [with_values(library.goal(visit, place), {STOP: 1.0}) for place in places]
        calls = [TopCall(visit, goal, frozenset({STOP})) for goal in goals]
        best = refiner.refine(start, TopChain(tuple(calls)), placeholders=True).best
        return best.calls[0].goal.values[STOP]

    assert first_stop(4.0) == 0.0
    assert first_stop(0.0) == 1.0


def test_the_heading_of_a_goal_that_is_passed_does_not_count() -> None:
    model = learned(passing=True)
    assert leg(model, v=0.0, stop=0.0, yawg=3.0) == leg(model, v=0.0, stop=0.0, yawg=0.0)
    assert not without_errors("pursue", legs(30, 3, passing=True))


def test_without_drives_that_pass_it_is_predicted_to_save_something_that_is_uncertain() -> None:
    model = learned(passing=False)
    assert model.passing is None
    stopping, known = leg(model, v=0.0, stop=1.0)
    passing, spread = leg(model, v=0.0, stop=0.0)
    assert 0.1 < stopping - passing < 1.5
    assert spread > stopping - passing > known
    assert "stopg" in model.not_varied


def test_actions_that_cannot_pass_have_no_further_features() -> None:
    pursuit = find_domain("pursuit").candidates("pursue")
    names = [feature.name for feature in DOMAIN.candidates("pursue")]
    assert [feature.name for feature in pursuit] == names[: len(pursuit)]
    assert names[len(pursuit) :] == ["stopg", "rests", "moving_turn"]


def test_a_leg_that_passes_its_goal_without_a_route_is_unknown() -> None:
    def without_routes(*_: object) -> None:
        return None

    domain = replace(DOMAIN.on_map(hall_map()), planner=lambda *_: without_routes)
    known = {feature.name: feature for feature in domain.candidates("pursue")}
    features = [known["route_length"], known["stopg"]]
    direct = {**LEG, "x": -2.0, "v": 0.4, "stopg": 0.0, "yawg": 0.0}
    ((length, _),) = feature_table(direct, domain.robot(), features)
    assert np.isnan(length)
