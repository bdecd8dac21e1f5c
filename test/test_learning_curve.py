"""What observed models are worth against their episodes: one table, one oracle, resumable."""

from __future__ import annotations

import json
import runpy
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from ator_ros.evaluation.learning_curve import CurveSettings, LearningCurve, drawn, points
from ator_ros.files import read_text
from ator_ros.report.terminal_tables import curve_table
from ator_ros.tools.collect import main as collect
from ator_ros.tools.evaluate import main as evaluate

PROGRAM = Path(__file__).parents[1] / "benchmarks" / "learning_curve.py"


def test_draws_are_nested_and_differ() -> None:
    rows = pd.DataFrame({"episode": np.repeat(np.arange(50), 3)})
    small, large, other = (set(drawn(rows, *which)["episode"]) for which in ((10, 1), (20, 1), (10, 2)))
    assert small < large
    assert (len(small), len(large)) == (10, 20)
    assert small != other
    assert len(drawn(rows, 10, 1)) == 30
    assert drawn(rows, 50, 1) is rows


def record(index: int, times: list[float]) -> dict:
    run = {"described": [9.0, True], "30/0": [times[0], True], "30/1": [times[1], times[1] < 20.0]}
    return {
        "index": index,
        "naive": 10.0,
        "best": {"heading": 9.0, "heading and speed": 8.0},
        "runs": {"heading": run, "heading and speed": run},
    }


def test_shares_are_of_all_that_could_be_gained() -> None:
    told = points([record(0, [9.5, 9.0]), record(1, [9.5, 10.5])])
    assert told["heading"]["described"]["percent"] == pytest.approx(100.0)
    assert told["heading"]["30"]["draws"] == pytest.approx([50.0, 25.0])
    assert told["heading"]["30"]["percent"] == pytest.approx(37.5)
    assert told["heading and speed"]["30"]["percent"] == pytest.approx(37.5 / 2.0)
    assert told["heading"]["30"]["slower"] == pytest.approx(25.0)
    assert points([record(0, [9.5, 60.0])])["heading"]["30"]["failed"] == 1
    assert "37.5" in curve_table(told)


@pytest.mark.long
def test_a_curve_goes_on_where_it_was_interrupted(tmp_path: Path) -> None:
    table, out = tmp_path / "experience.parquet", tmp_path / "curve"
    words = ["--seed", "101", "--episodes", "60", "--actions", "goToPose", "dribbleBall", "--out", str(table)]
    assert collect(words) == 0
    main = runpy.run_path(str(PROGRAM))["main"]
    words = [str(table), "--seed", "431", "--sizes", "50", "1000", "--draws", "2", "--headings", "4"]
    words += ["--speeds", "0.4", "--out", str(out)]
    assert main([*words, "--situations", "1"]) == 0
    before = read_text(out / "situations.jsonl", 10**6)
    assert main([*words, "--situations", "2"]) == 0
    after = read_text(out / "situations.jsonl", 10**6)
    assert after.startswith(before)
    assert after.count("\n") == 3
    told = json.loads((out / "curve.json").read_text(encoding="utf-8"))
    assert told["situations"] == 2
    assert list(told["points"]["heading"]) == ["described", "50", "60"]
    assert [len(told["points"]["heading"][size]["draws"]) for size in ("50", "60")] == [2, 1]
    settings = CurveSettings(str(table), 431, (30,))
    assert [size for size, _ in LearningCurve(settings, tmp_path / "other").draws] == [30, 30, 30]
    assert main([*words, "--draws", "1", "--situations", "1"]) == 1  # a curve of other settings


@pytest.mark.long
def test_runs_can_be_taken_from_an_evaluation(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table, executed = tmp_path / "experience.parquet", tmp_path / "executed"
    words = ["--seed", "101", "--episodes", "40", "--actions", "goToPose", "dribbleBall", "--out", str(table)]
    assert collect(words) == 0
    oracle = ["--oracle", "4", "--oracle-margin", "1.0", "--oracle-speeds", "0.4", "--jobs", "1"]
    words = ["--seed", "431", "--situations", "2", "--policies", "naive", "gated", "gated_speed"]
    assert evaluate([*words, *oracle, "--out", str(executed)]) == 0
    main = runpy.run_path(str(PROGRAM))["main"]
    words = [str(table), "--seed", "431", "--sizes", "40", "--headings", "4", "--speeds", "0.4"]
    told = []
    for number, more in enumerate(([], ["--executed", str(executed)])):
        out = tmp_path / f"curve{number}"
        assert main([*words, *more, "--situations", "2", "--out", str(out)]) == 0
        told.append(json.loads((out / "curve.json").read_text(encoding="utf-8"))["points"])
    assert told[0] == told[1]
    taken = ["--executed", str(executed), "--out", str(tmp_path / "more")]
    assert main([*words, *taken, "--situations", "3"]) == 1
    assert "expected more than 2 situations, got 2" in capsys.readouterr().err
