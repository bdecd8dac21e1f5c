"""Table 1, from records with known outcomes."""

from typing import Any

import numpy as np
import pytest

from ator_ros.evaluation.statistics import prediction_errors, summarize


def record(index: int, naive: float, refined: float, oracle: float, **more: Any) -> dict[str, Any]:
    return {
        "index": index,
        "policies": {
            "naive": {"duration": naive, "success": naive < 30.0},
            "refined": {
                "duration": refined,
                "success": refined < 30.0,
                "predicted": refined - 0.1,
                "spread": 0.1,
            },
        },
        "oracle": {"best": oracle, "success": True},
        **more,
    }


RECORDS = [record(0, 10.0, 8.0, 7.5), record(1, 10.0, 10.1, 9.5), record(2, 10.0, 11.0, 9.0)]


def test_table_of_known_runs() -> None:
    row = summarize(RECORDS)["refined"]
    assert row["mean_duration_s"] == pytest.approx(29.1 / 3, abs=1e-3)
    assert row["improvement_percent"] == pytest.approx(3.0)
    assert (row["higher"], row["equal"], row["lower"]) == (1, 1, 1)
    assert row["mean_gain_higher_percent"] == pytest.approx(20.0)
    assert row["mean_loss_lower_percent"] == row["worst_loss_percent"] == pytest.approx(10.0)
    assert row["oracle_captured_percent"] == pytest.approx(100.0 * 0.9 / 4.0)
    assert row["failures"] == 0


def test_percent_of_sums_and_mean_of_ratios_differ() -> None:
    row = summarize([record(0, 20.0, 10.0, 10.0), record(1, 10.0, 10.0, 10.0)])["refined"]
    assert row["improvement_percent"] == pytest.approx(100.0 / 3.0, abs=1e-3)
    assert row["mean_ratio_improvement_percent"] == pytest.approx(25.0)


def test_failures_count_at_their_duration() -> None:
    summary = summarize([record(0, 10.0, 30.0, 9.0), record(1, 10.0, 9.0, 9.0)])
    assert summary["refined"]["failures"] == 1
    assert summary["refined"]["improvement_percent"] == pytest.approx(-95.0)
    assert summary["oracle"]["failures"] == 0


def test_equal_is_within_two_percent() -> None:
    durations = (9.79, 9.81, 10.19, 10.21)
    row = summarize([record(index, 10.0, each, 9.0) for index, each in enumerate(durations)])[
        "refined"
    ]
    assert (row["higher"], row["equal"], row["lower"]) == (1, 2, 1)


def test_an_improvement_lies_within_its_interval_and_identical_runs_have_none() -> None:
    rng = np.random.default_rng(3)
    durations = rng.uniform(9.0, 12.0, (40, 2))
    records = [record(i, naive, refined, 8.0) for i, (naive, refined) in enumerate(durations)]
    summary = summarize(records)
    for name in ("refined", "oracle"):
        low, high = summary[name]["improvement_ci95"]
        assert low < summary[name]["improvement_percent"] < high
    assert summary["naive"]["improvement_ci95"] == [0.0, 0.0]
    assert summary["naive"]["oracle_captured_percent"] == 0.0
    assert summary["oracle"]["oracle_captured_percent"] == 100.0
    assert summary["oracle"]["oracle_captured_ci95"] == [100.0, 100.0]
    low, high = summary["refined"]["oracle_captured_ci95"]
    assert low < summary["refined"]["oracle_captured_percent"] < high


def test_an_interval_shrinks_with_more_situations() -> None:
    def width(count: int) -> float:
        rng = np.random.default_rng(4)
        pairs = rng.uniform(9.0, 12.0, (count, 2))
        rows = [record(i, naive, refined, 8.0) for i, (naive, refined) in enumerate(pairs)]
        low, high = summarize(rows)["refined"]["improvement_ci95"]
        return float(high - low)

    assert width(160) == pytest.approx(0.5 * width(40), rel=0.4)


def test_no_share_is_captured_of_an_oracle_that_saves_nothing() -> None:
    rows = summarize([record(0, 10.0, 9.0, 10.0)])
    assert rows["refined"]["oracle_captured_percent"] is None
    assert "oracle_captured_ci95" not in rows["refined"]
    little = summarize([record(0, 10.0, 9.995, 9.99)])
    assert little["refined"]["oracle_captured_percent"] == pytest.approx(50.0)


def test_without_an_oracle_no_share_is_known() -> None:
    without = [{"policies": row["policies"]} for row in RECORDS]
    summary = summarize(without)
    assert set(summary) == {"naive", "refined"}
    assert summary["refined"]["oracle_captured_percent"] is None


def test_policies_that_choose_speeds_are_compared_with_the_oracle_that_does() -> None:
    rows = [record(0, 10.0, 9.0, 8.0, oracle_speed={"best": 6.0, "success": True})]
    rows[0]["policies"]["refined_speed"] = {"duration": 7.0, "success": True}
    summary = summarize(rows)
    assert summary["refined"]["oracle_captured_percent"] == pytest.approx(50.0)
    assert summary["refined_speed"]["oracle_captured_percent"] == pytest.approx(75.0)
    assert summary["oracle_speed"]["improvement_percent"] == pytest.approx(40.0)


def test_a_policy_that_never_loses_has_no_worst_loss() -> None:
    row = summarize([record(0, 10.0, 8.0, 7.0), record(1, 10.0, 6.0, 5.0)])["refined"]
    assert row["worst_loss_percent"] == 0.0
    assert row["mean_loss_lower_percent"] == 0.0
    assert row["mean_gain_higher_percent"] == 30.0
    worse = summarize([record(0, 10.0, 12.0, 7.0), record(1, 10.0, 14.0, 5.0)])["refined"]
    assert worse["worst_loss_percent"] == 40.0
    assert worse["mean_gain_higher_percent"] == 0.0
    assert worse["mean_loss_lower_percent"] == 30.0


def test_errors_of_predictions_count_chains_that_succeeded() -> None:
    rows = [record(0, 10.0, 8.0, 7.0), record(1, 10.0, 31.0, 7.0), record(2, 10.0, 9.0, 7.0)]
    rows[0]["policies"]["refined"] |= {"predicted": 8.3, "spread": 0.1}
    rows[2]["policies"]["refined"] |= {"predicted": 8.9, "spread": 0.1}
    found = prediction_errors(rows, "refined")
    assert found["chains"] == 2
    assert found["mean_error_s"] == pytest.approx(0.1)
    assert found["mae_s"] == pytest.approx(0.2)
    assert found["rmse_s"] == pytest.approx(0.05**0.5, abs=1e-3)
    assert found["mean_error_ci95"] == [pytest.approx(-0.1), pytest.approx(0.3)]
    assert found["within_90_percent"] == 50.0
    assert "gain_predicted_s" not in found
    assert prediction_errors(rows, "naive") == {"chains": 0}


def test_predicted_gains_are_compared_with_executed_ones() -> None:
    rows = [record(0, 10.0, 8.0, 7.0), record(1, 10.0, 9.0, 7.0)]
    for row, gain in zip(rows, (2.5, 0.5), strict=True):
        row["policies"]["naive"] |= {"predicted": 10.0, "spread": 0.1}
        row["policies"]["refined"] |= {"predicted": 10.0 - gain, "spread": 0.1}
    found = prediction_errors(rows, "refined")
    assert found["gain_predicted_s"] == pytest.approx(1.5)
    assert found["gain_executed_s"] == pytest.approx(1.5)
    assert "gain_predicted_s" not in prediction_errors(rows, "naive")
