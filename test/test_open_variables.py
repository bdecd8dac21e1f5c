"""What `study` says of each open variable: what it gains, or why it gains nothing."""

from __future__ import annotations

import dataclasses

import pytest

from ator_ros.evaluation.study import OpenVariable, open_variables
from ator_ros.evaluation.toolset import Toolset, ToolsetSource, tools_of
from ator_ros.evaluation.trials import Trial, random_trial
from ator_ros.refinement.gate import ThresholdGate


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
