"""The model of an action without drives, and what the first few drives add to it."""

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from experience_rows import dead_zone_drives, dead_zone_time

from ator_ros.actions.goal_variables import ORDER
from ator_ros.domains.available_models import models_for
from ator_ros.domains.domain import Domain, find_domain
from ator_ros.files import FileError
from ator_ros.geometry import Pose
from ator_ros.performance.features import PATHS, feature_table
from ator_ros.performance.model import PerformanceModel, Prediction
from ator_ros.performance.model_file import load_model, save_model
from ator_ros.performance.path_times import path_time_model, path_times_remark
from ator_ros.performance.training import direct_of, train
from ator_ros.refinement.gate import Gate
from ator_ros.refinement.refiner import Refinement, Refiner
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.world.state import RobotState, World

TOUR = find_domain("tour")
ROBOT = TOUR.robot()
ACTION = "drive_to"
MODEL = path_time_model(ACTION, "default", ROBOT)


def drives(count: int, seed: int = 1) -> pd.DataFrame:
    rows = dead_zone_drives(count, seed=seed)
    duration = dead_zone_time(rows)
    return rows.assign(time_to_go=duration, duration=duration)


def predicted(model: PerformanceModel, rows: pd.DataFrame) -> Prediction:
    return model.predict(direct_of(rows), ("duration", "spread", "success"))


def mean_error(model: PerformanceModel, rows: pd.DataFrame) -> float:
    return float(np.abs(predicted(model, rows).duration - rows["duration"]).mean())


def test_without_drives_it_predicts_the_fastest_path_and_no_success() -> None:
    rows = drives(20)
    found = predicted(MODEL, rows)
    fastest = feature_table(direct_of(rows), ROBOT, PATHS[:1])[:, 0]
    assert found.duration == pytest.approx(fastest)
    assert found.success is None
    assert not MODEL.is_learned


def test_without_drives_nine_of_ten_durations_are_within_the_interval() -> None:
    rows = drives(100)
    found = predicted(MODEL, rows)
    assert found.spread is not None
    off = np.abs(found.duration - rows["duration"]) / found.spread
    assert (off < 1.645).mean() > 0.9


def test_the_spread_grows_with_the_length_of_the_path() -> None:
    there = dict.fromkeys(("x", "y", "yaw", "yg", "yawg", "v", "w", "speedg", "hold"), 0.0)
    found = MODEL.predict({**there, "xg": np.array([1.0, 10.0, 100.0])}, ("spread",))
    assert found.spread is not None
    one, ten, hundred = found.spread
    assert one < ten < hundred
    assert hundred == pytest.approx(0.5 * 100.0 / ROBOT.greatest_speed(), rel=0.1)


def test_each_few_drives_make_it_better_and_more_certain() -> None:
    fresh = drives(60, seed=5)
    errors = [mean_error(MODEL, fresh)]
    spreads = [predicted(MODEL, fresh).spread.mean()]
    for count in (3, 8, 19):
        model = train(ACTION, drives(count), ROBOT)
        errors.append(mean_error(model, fresh))
        spreads.append(predicted(model, fresh).spread.mean())
    assert errors[1] < 0.7 * errors[0]
    assert errors[3] < errors[1]
    assert spreads == sorted(spreads, reverse=True)


def test_a_single_drive_is_predicted_again_within_its_noise() -> None:
    rows = drives(1)
    model = train(ACTION, rows, ROBOT)
    assert mean_error(model, rows) < 0.3
    assert mean_error(MODEL, rows) > 0.3
    assert model.rules().endswith("and what 1 drives took longer than that in similar situations")


def test_a_model_of_few_drives_can_be_stored(tmp_path: Path) -> None:
    model = train(ACTION, drives(6), ROBOT)
    save_model(tmp_path / "model.json", model)
    again = load_model(tmp_path / "model.json", ROBOT, TOUR.known_features)
    fresh = drives(10, seed=5)
    for one, other in ((predicted(model, fresh), predicted(again, fresh)),):
        assert one.duration == pytest.approx(other.duration)
        assert one.spread == pytest.approx(other.spread)


def refined(places: list[tuple[float, float]], opened: frozenset[str]) -> Refinement:
    library = TOUR.library(ROBOT)
    top = library.usable()[0]
    calls = tuple(TopCall(top, library.goal(top, Pose(x, y, 0.0)), opened) for x, y in places)
    world = World(0.0, RobotState(Pose(-4.0, 0.0, 0.0)))
    refiner = Refiner(ROBOT, {ACTION: MODEL}, Gate())
    return refiner.refine(world, TopChain(calls), placeholders=True)


def test_without_drives_the_gate_lets_a_much_shorter_order_pass_but_no_doubtful_heading() -> None:
    back_and_forth = [(3.0, 0.0), (-3.0, 1.0), (3.0, 1.0), (-3.0, 2.0), (3.0, 2.0)]
    answer = refined(back_and_forth, frozenset({ORDER}))
    assert answer.refined
    assert answer.saved > answer.uncertainty > 0.1 * answer.saved
    answer = refined([(3.0, 0.0), (3.0, 3.0), (-3.0, 3.0)], frozenset({"yaw"}))
    assert not answer.refined
    assert "path times of drive_to, as no drives are known yet" in answer.reason


def test_actions_without_a_file_have_path_times(tmp_path: Path) -> None:
    pursuit = find_domain("pursuit")
    assert not pursuit.shipped_models.exists()
    for domain, folder in ((pursuit, None), (TOUR, tmp_path)):
        models = models_for(domain, domain.robot(), folder=folder)
        assert set(models) == set(domain.actions())
        assert not any(model.is_learned for model in models.values())
    assert models_for(TOUR, ROBOT)[ACTION].is_learned
    with pytest.raises(FileError, match="expected a folder of models"):
        models_for(TOUR, ROBOT, folder=tmp_path / "nowhere")


def building() -> Domain:
    return find_domain("building")


def test_on_a_map_it_predicts_the_time_of_the_route() -> None:
    domain = building()
    robot = domain.robot()
    action, spec = next(iter(domain.actions().items()))
    model = path_time_model(action, "default", robot)
    found = spec.situation(robot, np.random.default_rng(2))
    direct = {
        **{name: getattr(found.robot.pose, name) for name in ("x", "y", "yaw")},
        **{f"{name}g": getattr(found.goal.pose, name) for name in ("x", "y", "yaw")},
        **dict.fromkeys(("v", "w", "speedg", "hold"), 0.0),
    }
    duration = model.predict(direct).duration
    assert duration is not None
    straight = math.dist(found.robot.pose[:2], found.goal.pose[:2]) / robot.greatest_speed()
    assert duration[0] >= straight


def test_a_remark_names_the_actions() -> None:
    assert path_times_remark([]) == ""
    assert path_times_remark(["a", "b"]) == "path times of a, b, as no drives are known yet"
