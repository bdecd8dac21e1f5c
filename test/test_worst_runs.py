"""The runs of an evaluation in which refinement did worst, and evaluations that make no sense."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from in_process_stage import InProcessStage

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.evaluation.running import KIND
from ator_ros.evaluation.trials import EvaluationError
from ator_ros.files import head
from ator_ros.viewing.desk import Desk
from ator_ros.viewing.worst import worst_trials

ROBOT = SOCCER.robot()
EVALUATION = Path(__file__).resolve().parents[1] / "docs" / "evaluation"


def test_worst_runs_of_an_evaluation_are_its_situations_again() -> None:
    runs = worst_trials(EVALUATION, SOCCER, ROBOT)
    data = json.loads((EVALUATION / "evaluation.json").read_text())["runs"]["policies"]
    losses = [a - b for a, b in zip(data["gated"]["duration"], data["naive"]["duration"], strict=True)]
    label, trial = runs[0]
    assert losses[trial.index] == max(losses)
    assert label.startswith(f"situation {trial.index}: {max(losses):+.2f} s")
    stage = InProcessStage(SOCCER, ROBOT)
    desk = Desk(stage, SOCCER, stage.libraries)
    desk.show(trial)
    desk.step()
    assert desk.draft.world == trial.world


def test_a_folder_without_an_evaluation_is_told(tmp_path: Path) -> None:
    with pytest.raises(EvaluationError, match=r"evaluation\.json") as told:
        worst_trials(tmp_path, SOCCER, ROBOT)
    assert str(told.value) == f"{tmp_path / 'evaluation.json'}: expected a JSON file, there is none"


DAMAGE: dict[str, tuple[tuple[str, ...], object]] = {
    "settings.seed": (("settings", "seed"), -1),
    "settings.chain": (("settings", "chain"), "chess"),
    "settings.source.action_set": (("settings", "source", "action_set"), "../other"),
    "runs.index[0]": (("runs", "index"), [-1, 2]),
    "runs.policies": (("runs", "policies"), {"naive": {"duration": [1.0], "success": [True]}}),
    "runs: expected columns": (("runs", "policies", "gated", "success"), [True]),
    "runs.policies.naive.duration[1]": (("runs", "policies", "naive", "duration"), [1.0, "long"]),
    "runs.policies.naive": (("runs", "policies", "naive"), None),
}


@pytest.mark.parametrize("field", DAMAGE)
def test_an_evaluation_that_makes_no_sense_is_told_in_one_line(tmp_path: Path, field: str) -> None:
    runs = {"duration": [2.0, 3.0], "success": [True, False]}
    data: dict[str, Any] = {
        **head(KIND), "summary": {"situations": 10**15},
        "settings": {"seed": 3, "chain": "dribble", "source": {"action_set": "default"}},
        "runs": {"index": [4, 7], "policies": {"naive": runs, "gated": dict(runs)}},
    }  # fmt: skip
    file = tmp_path / "evaluation.json"
    file.write_text(json.dumps(data))
    assert [label for label, _ in worst_trials(tmp_path, SOCCER, ROBOT)] == [
        "situation 7: failed against 3.00 s", "situation 4: +0.00 s against 2.00 s"
    ]  # fmt: skip
    (*path, last), value = DAMAGE[field]
    place = data
    for name in path:
        place = place[name]
    place[last] = value
    file.write_text(json.dumps(data))
    with pytest.raises(EvaluationError) as told:
        worst_trials(tmp_path, SOCCER, ROBOT)
    assert str(told.value).startswith(f"{file}: {field}")
    assert "\n" not in str(told.value)
