"""Training, prediction, accuracy and explanation of performance models."""

import numpy as np
import pytest
from experience_rows import synthetic_experience

from ator_ros.bases.description import load_robot
from ator_ros.bases.direct import DIRECT_VARIABLES
from ator_ros.experience.table import ExperienceError
from ator_ros.geometry import wrap_angles
from ator_ros.performance.accuracy import accuracy, brier
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.training import direct_of, train

ROBOT = load_robot()
ROWS = synthetic_experience("goToPose")
FRESH = synthetic_experience("goToPose", seed=2)


@pytest.fixture(scope="module")
def model() -> PerformanceModel:
    return train("goToPose", ROWS, ROBOT)


def test_predictions_are_accurate_on_fresh_episodes(model: PerformanceModel) -> None:
    result = accuracy(model, FRESH, seed=2)
    assert result["mae_s"] < 0.15
    assert result["mae_s_ci95"][0] < result["mae_s"] < result["mae_s_ci95"][1]
    assert result["rmse_s"] >= result["mae_s"]
    assert result["episodes"] == FRESH["success"].sum()


def test_success_is_predicted_better_than_by_the_base_rate(model: PerformanceModel) -> None:
    rows = synthetic_experience("goToPose", episodes=2000, seed=3)
    learned = train("goToPose", rows, ROBOT)
    result = brier(learned, FRESH, seed=2)
    assert result["brier"] < result["brier_base_rate"]


def test_a_few_scattered_failures_make_no_situation_likely_to_fail() -> None:
    rows = synthetic_experience("goToPose", episodes=400)
    rows["success"] = ~rows["episode"].isin([17, 100, 230, 390])
    predicted = train("goToPose", rows, ROBOT).predict(direct_of(rows), ("success",)).success
    assert predicted == pytest.approx(0.99, abs=1e-6)


def test_sixty_drives_show_where_a_server_turns_on_the_spot_or_drives_backward() -> None:
    rows, fresh = (synthetic_experience("goToPose", episodes=n, seed=n) for n in (60, 200))
    for table in (rows, fresh):
        dx, dy = table["xg"] - table["x"], table["yg"] - table["y"]
        aside = np.degrees(np.abs(wrap_angles((np.arctan2(dy, dx) - table["yaw"]).to_numpy())))
        table["duration"] = np.hypot(dx, dy) + 2.0 * (aside > 45.0) - 1.5 * (aside > 120.0)
        table["time_to_go"], table["success"] = table["duration"], True
    learned = train("goToPose", rows, ROBOT)
    assert accuracy(learned, fresh, seed=2)["mae_s"] < 0.3
    assert "(angle_to_dest > " in learned.rules()


def test_rules_and_explanation_name_the_features_with_units(model: PerformanceModel) -> None:
    assert "time = " in model.rules()
    assert "[s]" in model.rules()
    situation = {name: float(FRESH[name].iloc[0]) for name in DIRECT_VARIABLES}
    text = model.explain(situation)
    assert f"here time = {model.predict(situation).duration[0]:.3f}" in text


def test_experience_without_success_is_rejected() -> None:
    failed = ROWS.head(10).assign(success=False)
    with pytest.raises(ExperienceError, match=r"expected episodes that succeeded, got none of \d+"):
        train("goToPose", failed, ROBOT)
