"""The report of a study: gains of open variables, and the page."""

import dataclasses
from pathlib import Path
from typing import Any

import pytest
from documentation import ROOT
from experience_rows import uncertain
from refinement_fakes import LIBRARY, ROBOT, FakeModel, models, turning_time

from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.domains.trials import Trial, random_trial
from ator_ros.evaluation.study_report import open_variables, study_page
from ator_ros.evaluation.toolset import Toolset, ToolsetSource, tools_of
from ator_ros.files import read_json


def test_a_study_without_a_chain_is_shown() -> None:
    action = {
        "episodes": 4,
        "success": 0.0,
        "mean_duration_s": None,
        "accuracy": {},
        "failures": {"lost": 4},
    }
    variable = {
        "step": 2,
        "top": "visit",
        "name": "yaw",
        "free": 0.25,
        "gain_s": 0.0,
        "explanation": "none",
    }
    page = study_page(
        {
            "command": "study", "robot": "cart", "domain": "soccer", "action_set": "default",
            "actions": {"goToPose": action}, "left_out": {"shoot": "no holder"}, "evaluation": None,
            "variables": [variable],
        }
    )  # fmt: skip
    texts = ("no holder", "No chain of the domain can be executed", "2 (visit)", ">25 %<", ">0.00<")
    for text in texts:
        assert text in page


@pytest.fixture(scope="module")
def tools() -> Toolset:
    return tools_of(ToolsetSource())[0]


@pytest.fixture(scope="module")
def trials(tools: Toolset) -> list[Trial]:
    _, library = tools_of(ToolsetSource())
    return [
        random_trial(tools.domain, "dribble", library, seed=77, index=index) for index in range(4)
    ]


def found(tools: Toolset, trials: list[Trial]) -> dict[str, Any]:
    return {each["name"]: each for each in open_variables(tools, trials)}


def test_gains_are_reported_for_each_variable(tools: Toolset, trials: list[Trial]) -> None:
    variables = found(tools, trials)
    assert set(variables) == {"yaw", "speed"}
    for each in variables.values():
        assert (each["step"], each["top"], each["free"]) == (1, "goToBall", 1.0)
        assert each["explanation"].startswith(
            f"predicted to gain {each['gain_s']:.2f} s on average; the gate accepts it in "
        )


def test_a_gate_that_rejects_everything_is_reported(tools: Toolset, trials: list[Trial]) -> None:
    models = {name: uncertain(model) for name, model in tools.models.items()}
    yaw = found(dataclasses.replace(tools, models=models), trials)["yaw"]
    assert yaw["explanation"].startswith("the gate refuses all gains, of ")


@pytest.mark.parametrize(
    "file", sorted((ROOT / "docs" / "studies").glob("*.json")), ids=lambda file: file.stem
)
def test_a_published_study_is_shown(file: Path) -> None:
    assert f"{file.stem}: actions and their refinement" in study_page(
        {"variables": [], **read_json(file)}
    )


def test_gains_are_those_of_one_variable_alone() -> None:
    """Models that depend on nothing but the heading gain by the heading only."""
    used = frozenset({"x", "y", "yaw", "xg", "yg", "yawg"})

    def turns(direct: Any) -> Any:
        return turning_time({**direct, "v": 0.4, "speedg": 0.5})

    fakes = {name: FakeModel(turns, used, spread=0.0) for name in models()}
    drawn = [random_trial(SOCCER, "dribble", LIBRARY, seed=78, index=index) for index in range(2)]
    variables = found(Toolset(SOCCER, ROBOT, fakes), drawn)
    assert variables["yaw"]["gain_s"] > 0.1
    assert "the gate accepts it in 2 of 2 situations" in variables["yaw"]["explanation"]
    assert variables["speed"]["free"] == 0.0
    assert variables["speed"]["gain_s"] == 0.0


def test_a_variable_without_effect_is_reported() -> None:
    constant = {
        name: FakeModel(lambda _: 5.0, frozenset({"yaw", "yawg", "xg"})) for name in models()
    }
    drawn = [random_trial(SOCCER, "dribble", LIBRARY, seed=78, index=0)]
    yaw = found(Toolset(SOCCER, ROBOT, constant), drawn)["yaw"]
    assert yaw["explanation"] == "no effect: the models predict a gain of 0.00 s on average"
    assert yaw["free"] == 1.0


def test_numbers_of_actions_are_rounded_or_missing() -> None:
    row = {
        "episodes": 7,
        "success": 0.98765,
        "mean_duration_s": 5.4321,
        "accuracy": {"mae_s": 0.1234},
    }
    result = {
        "command": "study --seed 3",
        "robot": "cart",
        "domain": "soccer",
        "action_set": "bezier",
    }
    page = study_page(
        {
            **result,
            "actions": {"goToPose": row},
            "left_out": {},
            "evaluation": None,
            "variables": [],
        }
    )
    for text in (
        ">98.77 %<",
        ">5.43<",
        ">0.123<",
        ">-<",
        ">7<",
        "action set bezier",
        "study --seed 3",
    ):
        assert text in page
    for text in ("cannot do", "Open variables", "Refinement of"):
        assert text not in page
