"""Training, prediction, accuracy and explanation of performance models."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from experience_rows import made_up_experience

from ator_ros.performance.accuracy import accuracy, brier, kinds
from ator_ros.performance.direct import DIRECT_VARIABLES
from ator_ros.performance.features import PAPER_3, derived_from
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.training import (
    Training,
    TrainingError,
    direct_of,
    observed_model,
    observed_starts,
    start_ranges,
    train,
)
from ator_ros.robot.description import load_robot

ROBOT = load_robot()
ROWS = made_up_experience("goToPose")
FRESH = made_up_experience("goToPose", seed=2)
MEASURES = ("duration", "success", "accuracy", "heading")


@pytest.fixture(scope="module")
def model() -> PerformanceModel:
    return train("goToPose", ROWS, ROBOT)


def test_predictions_are_accurate_on_fresh_episodes(model: PerformanceModel) -> None:
    result = accuracy(model, FRESH, seed=2)
    assert result["mae_s"] < 0.15
    assert result["mae_s_ci95"][0] < result["mae_s"] < result["mae_s_ci95"][1]
    assert result["rmse_s"] >= result["mae_s"]
    assert result["episodes"] == FRESH["success"].sum()


def test_only_what_is_asked_for_is_computed(model: PerformanceModel) -> None:
    direct = direct_of(FRESH)
    prediction = model.predict(direct)
    assert prediction.duration is not None
    assert prediction.duration.shape == prediction.spread.shape == (len(FRESH),)
    assert prediction.success is None
    every = model.predict(direct, MEASURES)
    assert all(getattr(every, name).shape == (len(FRESH),) for name in MEASURES)
    assert np.array_equal(every.duration, prediction.duration)
    assert np.all((every.success >= 0.0) & (every.success <= 1.0))


def test_used_variables_are_those_the_prediction_changes_with(model: PerformanceModel) -> None:
    assert set(model.used_features) <= {name for tree in model.trees.values() for name in tree.names}
    used = {name for tree in model.trees.values() for name in tree.used_features()}
    assert model.used_variables == derived_from(model.features[name] for name in used)
    direct = direct_of(FRESH)
    before = model.predict(direct).duration
    for name in set(DIRECT_VARIABLES) - model.used_variables:
        assert np.array_equal(model.predict({**direct, name: direct[name] + 0.3}).duration, before)


def test_success_is_predicted_better_than_by_the_base_rate(model: PerformanceModel) -> None:
    rows = made_up_experience("goToPose", episodes=2000, seed=3)
    learned = train("goToPose", rows, ROBOT)
    result = brier(learned, FRESH, seed=2)
    assert result["brier"] < result["brier_base_rate"]


def test_a_handful_of_failures_anywhere_makes_no_situation_likely_to_fail() -> None:
    rows = made_up_experience("goToPose", episodes=400)
    rows["success"] = ~rows["episode"].isin([17, 100, 230, 390])
    predicted = train("goToPose", rows, ROBOT).predict(direct_of(rows), ("success",)).success
    assert predicted is not None
    assert predicted == pytest.approx(0.99, abs=1e-6)


def test_rules_and_explanation_name_the_features_with_units(model: PerformanceModel) -> None:
    assert "time = " in model.rules()
    assert "[s]" in model.rules()
    situation = {name: float(FRESH[name].iloc[0]) for name in DIRECT_VARIABLES}
    text = model.explain(situation)
    assert f"here time = {model.predict(situation).duration[0]:.3f}" in text


def test_later_examples_count_only_with_a_weight(model: PerformanceModel) -> None:
    later = ROWS.assign(t=0.1, time_to_go=99.0)
    rows = pd.concat([ROWS, later], ignore_index=True)
    direct = direct_of(FRESH)
    assert np.array_equal(
        train("goToPose", rows, ROBOT).predict(direct).duration, model.predict(direct).duration
    )
    weighted = train("goToPose", rows, ROBOT, training=Training(later_weight=1.0))
    assert weighted.predict(direct).duration.mean() > 30.0


def test_an_unknown_action_is_learned_with_the_general_features() -> None:
    model = train("fly", made_up_experience("fly"), ROBOT)
    assert accuracy(model, FRESH, seed=2)["mae_s"] < 0.2


def test_too_little_experience_is_refused() -> None:
    with pytest.raises(TrainingError, match=r"expected at least 20 episodes that succeeded, got \d+ of 10"):
        train("goToPose", ROWS.head(10), ROBOT)


def test_errors_that_were_not_observed_are_not_learned() -> None:
    model = train("goToPose", ROWS.assign(position_error=np.nan), ROBOT)
    assert "accuracy" not in model.trees
    assert model.predict(direct_of(FRESH), ("accuracy",)).accuracy is None


def test_kinds_of_starts_are_told_apart() -> None:
    far = FRESH.assign(xg=FRESH["x"] + 2.0)
    near = FRESH[:10].assign(xg=FRESH["x"] + 0.2, yg=FRESH["y"])
    rows = pd.concat([far, far.assign(v=0.5), far.assign(hold=1, speedg=0.4), near], ignore_index=True)
    parts = dict(kinds(rows, ROBOT))
    assert len(parts["at rest"]) == 600
    assert len(parts["turns, and drives below 0.5 m"]) == 10
    assert len(parts["in motion"]) == len(parts["at rest, pose"]) == 300
    assert len(parts["at rest, object, arriving at speed"]) == 300
    assert "at rest, object, arriving at rest" not in parts


def test_the_ranges_of_the_starts_are_kept_for_the_search() -> None:
    ranges = start_ranges(ROWS, ROBOT)
    starts = ROWS[ROWS["t"] == 0.0]
    assert ranges["xg"] == [starts["xg"].min(), starts["xg"].max()]
    assert {"yaw", "yawg", "hold"} & set(ranges) == set()
    assert 0.0 <= ranges["way"][0] <= ranges["way"][1] < 20.0


def braking_of(count: int, goal_speed: float = 0.0) -> float:
    """Return the known deceleration of `count` episodes over 2 m whose speeds rise evenly up to 1 m/s."""
    row = dict.fromkeys(ROWS.columns, 0.0) | {"success": True, "xg": 2.0, "speedg": goal_speed}
    rows = pd.DataFrame([row | {"v": (number + 1) / count} for number in range(count)])
    failed = pd.DataFrame([row | {"v": 1.0, "xg": 0.2, "success": False}])
    return observed_starts(pd.concat([rows, failed]), ROBOT)["braking"][1]


@pytest.mark.parametrize(("count", "beyond"), [(40, 2), (100, 5), (300, 15), (1000, 15)])
def test_decelerations_are_known_that_enough_episodes_asked_for(count: int, beyond: int) -> None:
    speed = (count - beyond + 1) / count
    assert braking_of(count) == pytest.approx(speed**2 / 4.0)
    assert braking_of(count, 0.5) == pytest.approx((speed**2 - 0.25) / 4.0)


def test_an_observed_model_knows_what_its_episodes_reach() -> None:
    model = observed_model("goToPose", ROWS, ROBOT, PAPER_3)
    assert model.experience["way"] == tuple(start_ranges(ROWS, ROBOT)["way"])
    assert model.experience["braking"] == tuple(observed_starts(ROWS, ROBOT)["braking"])
