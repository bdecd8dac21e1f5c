"""The actions beside the time-optimal motion."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from ator_ros.domains.soccer.quality.action_quality import Outcome, summary
from ator_ros.domains.soccer.quality.quality_result import OverOptimal
from ator_ros.domains.soccer.quality.ruler import over_time_optimal
from ator_ros.geometry import Pose

START, GOAL = Pose(0.0, 0.0, 0.0), Pose(1.0, 2.0, 0.5)


def outcome(duration: float, goal: Pose = GOAL, *, success: bool = True) -> Outcome:
    return Outcome(success, False, duration, 1.0, (START, goal), "")


def test_times_of_the_same_pairs_are_compared_where_both_arrived(tmp_path: Path) -> None:
    outcomes = [outcome(3.0), outcome(5.0), outcome(30.0, success=False), outcome(9.0)]
    assert over_time_optimal("pose", outcomes, tmp_path) is None
    assert json.loads((tmp_path / "pairs_pose.json").read_text()) == [[list(START), list(GOAL)]] * 4
    (tmp_path / "optimal_pose.json").write_text("[2.0, 3.0, 1.0, null]")
    assert over_time_optimal("pose", outcomes, tmp_path) == OverOptimal(2, 2.5, 1.6)
    assert over_time_optimal("approach", outcomes, tmp_path) is None


@pytest.mark.parametrize("times", ["[2.0]", "[2.0, 3.0]", "no JSON", "{}"])
def test_times_of_other_pairs_are_left_out_and_left_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], times: str
) -> None:
    over_time_optimal("pose", [outcome(3.0)], tmp_path)
    (tmp_path / "optimal_pose.json").write_text(times)
    before = (tmp_path / "pairs_pose.json").read_text()
    others = [outcome(3.0, START)] * (2 if times == "[2.0, 3.0]" else 1)
    assert over_time_optimal("pose", others, tmp_path) is None
    assert "optimal_pose.json: left out: expected times of the" in capsys.readouterr().err
    assert (tmp_path / "pairs_pose.json").read_text() == before


def test_runs_without_a_plan_are_left_out_of_the_comparison_with_plans() -> None:
    planned = [dataclasses.replace(outcome(3.0), planned=2.9), dataclasses.replace(outcome(5.0), planned=4.7)]
    told = summary("pose", [*planned, outcome(0.0)])
    assert told.over_plan_mean_s == 0.2
    assert told.over_plan_std_s == 0.1
    assert summary("pose", [outcome(3.0)]).over_plan_mean_s is None
