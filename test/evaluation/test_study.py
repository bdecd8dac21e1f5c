"""What `study` says of each open variable, and the studies in docs/."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from ator_ros.evaluation.study import KIND, OpenVariable, StudyResult, open_variables
from ator_ros.evaluation.toolset import Toolset, ToolsetSource, tools_of
from ator_ros.evaluation.trials import Trial, random_trial
from ator_ros.files import content_of, read_json, save
from ator_ros.refinement.gate import ThresholdGate
from ator_ros.schema import structured


@pytest.fixture(scope="module")
def tools() -> Toolset:
    return tools_of(ToolsetSource())[0]


@pytest.fixture(scope="module")
def trials(tools: Toolset) -> list[Trial]:
    _, library = tools_of(ToolsetSource())
    return [random_trial(tools.domain, "dribble", library, seed=77, index=index) for index in range(4)]


def found(tools: Toolset, trials: list[Trial]) -> dict[str, OpenVariable]:
    return {each.name: each for each in open_variables(tools, trials)}


def test_gains_are_told_for_each_variable_alone(tools: Toolset, trials: list[Trial]) -> None:
    variables = found(tools, trials)
    assert set(variables) == {"yaw", "speed"}
    for each in variables.values():
        assert (each.step, each.top, each.free) == (1, "goToBall", 1.0)
        assert each.explanation.startswith(f"gains {each.gain_s:.2f} s on average; the gate accepts it in ")


def test_a_model_that_never_saw_arrivals_at_speed_is_named(tools: Toolset, trials: list[Trial]) -> None:
    model = tools.models["dribbleBall"]
    training = model.metadata["training"]
    starts = {**training["starts"], "v": [0.0, 0.0]}
    slow = dataclasses.replace(model, metadata={**model.metadata, "training": {**training, "starts": starts}})
    models = {**tools.models, "dribbleBall": slow}
    speed = found(dataclasses.replace(tools, models=models), trials)["speed"]
    assert speed.free == 0.0
    assert speed.explanation == "no experience: beyond the experience of dribbleBall: v from 0.00 to 0.00"


def test_an_action_without_a_model_is_named(tools: Toolset, trials: list[Trial]) -> None:
    models = {"goToPose": tools.models["goToPose"]}
    yaw = found(dataclasses.replace(tools, models=models), trials)["yaw"]
    assert yaw.explanation.startswith("no experience: of unknown effect: step 2 (dribbleBall)")


def test_a_gate_that_refuses_everything_is_named(tools: Toolset, trials: list[Trial]) -> None:
    yaw = found(dataclasses.replace(tools, gate=ThresholdGate(100.0)), trials)["yaw"]
    assert yaw.explanation.startswith("the gate refuses all gains: ")


DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.parametrize("file", sorted((DOCS / "studies").glob("*.json")), ids=lambda file: file.stem)
def test_a_study_is_read_whole(file: Path, tmp_path: Path) -> None:
    data = read_json(file)
    result = structured(content_of(data, KIND), StudyResult, closed=True)
    assert result.robot == file.stem
    save(tmp_path / "study.json", KIND, result)
    assert json.loads((tmp_path / "study.json").read_text()) == {"variables": [], **data}
