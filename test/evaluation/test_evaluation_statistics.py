"""Table 1, from records with known outcomes."""

from typing import Any

import pytest

from ator_ros.evaluation.statistics import summarize


def record(index: int, naive: float, refined: float, oracle: float, **more: Any) -> dict[str, Any]:
    return {
        "index": index,
        "policies": {
            "naive": {"duration": naive, "success": naive < 30.0},
            "refined": {"duration": refined, "success": refined < 30.0, "predicted": refined - 0.1},
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
