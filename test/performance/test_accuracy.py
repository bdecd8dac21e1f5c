"""Accuracy, its intervals, and direct variables as tables."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pandas as pd
import pytest
from experience_rows import synthetic_experience

from ator_ros.bases.description import load_robot
from ator_ros.bases.direct import DIRECT_VARIABLES, DirectTable, direct_table
from ator_ros.performance.accuracy import (
    RESAMPLES,
    accuracy,
    brier,
    kinds,
    mean_ci95,
    resampled_means,
)
from ator_ros.performance.model import PerformanceModel

ROBOT = load_robot()


def fake(**predicted: Any) -> PerformanceModel:
    """Return a model that predicts these arrays whatever the situation."""

    def predict(_: Any, measures: tuple[str, ...] = ("duration",)) -> Any:
        return SimpleNamespace(**{name: np.array(predicted[name]) for name in measures})

    return cast("PerformanceModel", SimpleNamespace(predict=predict))


def starts(durations: list[float], success: list[bool]) -> pd.DataFrame:
    rows = synthetic_experience("goToPose", episodes=len(durations))
    return rows.assign(duration=durations, success=success)


def test_errors_are_measured_on_episodes_that_succeeded() -> None:
    rows = starts([2.0, 4.0, 99.0, 6.0], [True, True, False, True])
    found = accuracy(fake(duration=[2.3, 3.8, 6.1]), rows, seed=7)
    errors = np.array([0.3, -0.2, 0.1])
    assert found["mae_s"] == pytest.approx(0.2)
    assert found["rmse_s"] == pytest.approx(np.sqrt((errors**2).mean()))
    assert found["bias_s"] == pytest.approx(0.2 / 3.0)
    assert found["mean_duration_s"] == pytest.approx(4.0)
    assert found["relative_error"] == pytest.approx(0.05)
    assert found["median_relative_error"] == pytest.approx(0.05)
    assert (found["episodes"], found["seed"]) == (3, 7)
    assert found["mae_s_ci95"] == [pytest.approx(0.1), pytest.approx(0.3)]
    assert found["rmse_s_ci95"] == [pytest.approx(0.1), pytest.approx(0.3)]


def test_drives_of_no_duration_count_as_one_tick() -> None:
    found = accuracy(fake(duration=[0.1, 0.1]), starts([0.0, 0.0], [True, True]), seed=1)
    assert found["relative_error"] == pytest.approx(2.0)
    assert found["median_relative_error"] == pytest.approx(2.0)


def test_the_brier_score_is_compared_with_that_of_the_rate() -> None:
    rows = starts([1.0] * 4, [True, True, True, False])
    found = brier(fake(success=[0.9, 0.9, 0.9, 0.1]), rows, seed=3)
    assert found["brier"] == pytest.approx(0.01)
    assert found["success_rate"] == 0.75
    assert found["brier_base_rate"] == pytest.approx(0.1875)
    low, high = found["brier_gain_ci95"]
    assert low < 0.1775 < high
    assert low > 0.0
    assert (found["episodes"], found["seed"]) == (4, 3)


def test_kinds_of_starts_are_separate_and_complete() -> None:
    rows = synthetic_experience("goToPose", episodes=60)
    rows.loc[:9, "v"] = 0.3
    rows.loc[10:14, "v"] = -0.3
    rows.loc[15:24, "x"] = rows.loc[15:24, "xg"] + 0.2
    rows.loc[15:24, "y"] = rows.loc[15:24, "yg"]
    found = kinds(rows, ROBOT)
    assert list(found) == ["at rest", "turns, and drives below 0.5 m", "in motion"]
    assert len(found["in motion"]) == 15
    assert set(found["turns, and drives below 0.5 m"].index) >= set(range(15, 25))
    assert sorted(row for part in found.values() for row in part.index) == list(range(60))


def test_an_interval_of_a_mean_has_its_standard_error() -> None:
    values = np.random.default_rng(5).normal(3.0, 2.0, 400)
    low, high = mean_ci95(values)
    error = values.std() / 20.0
    assert low == pytest.approx(values.mean() - 1.96 * error, abs=0.02)
    assert high == pytest.approx(values.mean() + 1.96 * error, abs=0.02)


def test_rows_are_resampled_together() -> None:
    rng = np.random.default_rng(6)
    one = rng.normal(size=30)
    means = resampled_means(np.stack([one, 2.0 * one, np.ones(30)]))
    assert means.shape == (3, RESAMPLES)
    assert means[1] == pytest.approx(2.0 * means[0])
    assert means[2] == pytest.approx(1.0)
    assert (resampled_means(one[None]) == resampled_means(one[None])).all()


def test_direct_variables_become_rows_of_a_table() -> None:
    direct = dict.fromkeys(DIRECT_VARIABLES, 0.5) | {"x": np.array([1.0, 2.0]), "loadg": 3.0}
    table = direct_table(direct, ["loadg"])
    assert table.names == (*DIRECT_VARIABLES, "loadg")
    assert table.table.shape == (len(DIRECT_VARIABLES) + 1, 2)
    assert table["x"].tolist() == [1.0, 2.0]
    assert table["yaw"].tolist() == [0.5, 0.5]
    assert table["loadg"].tolist() == [3.0, 3.0]
    assert len(table) == len(DIRECT_VARIABLES) + 1
    assert list(table) == list(table.names)
    assert "loadg" not in direct_table(direct)
    with pytest.raises(KeyError):
        table["mood"]


def test_a_table_with_the_same_rows_is_used_as_it_is() -> None:
    table = direct_table(dict.fromkeys(DIRECT_VARIABLES, 0.0))
    assert direct_table(table) is table
    wider = DirectTable((*table.names, "loadg"), np.zeros((len(DIRECT_VARIABLES) + 1, 1)))
    assert direct_table(wider) is not wider
    assert direct_table(wider).names == table.names


def test_missing_direct_variables_are_named() -> None:
    direct = dict.fromkeys(DIRECT_VARIABLES, 0.0)
    del direct["yawg"]
    with pytest.raises(ValueError, match="missing: yawg, loadg"):
        direct_table(direct, ["loadg"])
