"""The command line `study`, from experience to a page.

Its advice on open variables; studies in docs.
"""

import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest
from experience_rows import uncertain

from ator_ros.bases.description import load_robot
from ator_ros.domains.trials import Trial, random_trial
from ator_ros.evaluation.study_report import open_variables, study_page
from ator_ros.evaluation.toolset import Toolset, ToolsetSource, tools_of
from ator_ros.files import read_json
from ator_ros.resources import resource_path
from ator_ros.tools.study import main

DOCS = Path(__file__).parents[2] / "docs"
PIONEER = resource_path("config", "pioneer.yaml").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("robot") / "slower.yaml"
    file.write_text(PIONEER.replace("v: 1.2", "v: 0.9", 1), encoding="utf-8")
    return file


def command(robot: Path, out: Path, seed: str = "5") -> list[str]:
    sizes = ["--episodes", "20", "--situations", "10", "--oracle", "2", "--jobs", "1"]
    return ["--robot", str(robot), *sizes, "--seed", seed, "--out", str(out)]


@pytest.fixture(scope="module")
def studied(robot: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("study") / "out"
    assert main(command(robot, out)) == 0
    return out


@pytest.mark.long
def test_a_study_reports_actions_and_refinement(studied: Path, robot: Path) -> None:
    result = read_json(studied / "study.json")
    assert result["robot_digest"] == load_robot(robot).digest() != load_robot().digest()
    assert list(result["actions"]) == ["goToPose", "dribbleBall", "shoot"]
    for row in result["actions"].values():
        assert row["episodes"] == 40
        assert 0.5 <= row["success"] <= 1.0
        assert 1.0 < row["mean_duration_s"] < 30.0
        assert row["accuracy"]["mae_s"] > 0.0
    assert result["left_out"] == {}
    evaluation = result["evaluation"]
    assert (evaluation["situations"], evaluation["seed"]) == (10, 7)
    assert {"naive", "refined", "gated", "gated_speed", "oracle"} <= evaluation.keys()
    model = json.loads((studied / "models" / "goToPose.json").read_text(encoding="utf-8"))
    assert model["robot_digest"] == result["robot_digest"]
    assert {(row["step"], row["name"]) for row in result["variables"]} >= {(1, "yaw"), (1, "speed")}
    page = (studied / "study.html").read_text(encoding="utf-8")
    assert "dribbleBall" in page
    assert (studied / "evaluation" / "report.html").is_file()


@pytest.mark.long
def test_a_study_continues_after_an_interruption(studied: Path, robot: Path) -> None:
    def made() -> dict[str, int]:
        kept = [*studied.glob("*.parquet"), *(studied / "models").iterdir()]
        return {str(file): file.stat().st_mtime_ns for file in kept}

    before, text = made(), (studied / "study.json").read_bytes()
    (studied / "study.json").unlink()
    assert main(command(robot, studied)) == 0
    assert (studied / "study.json").read_bytes() == text
    assert made() == before
    (studied / "fresh.parquet").unlink()
    assert main(command(robot, studied)) == 0
    assert (studied / "study.json").read_bytes() == text


@pytest.mark.long
def test_a_folder_of_another_study_is_rejected(
    studied: Path, robot: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(command(robot, studied, seed="6")) == 1
    assert (
        "study.jsonl: expected a study with the same options, got others: choose"
        in capsys.readouterr().err
    )


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
    for text in ("no holder", "No chain of the domain can be executed", "2 (visit)"):
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


def test_a_model_without_arrivals_at_speed_is_reported(tools: Toolset, trials: list[Trial]) -> None:
    model = tools.models["dribbleBall"]
    training = model.metadata["training"]
    starts = {**training["starts"], "v": [0.0, 0.0]}
    slow = dataclasses.replace(
        model, metadata={**model.metadata, "training": {**training, "starts": starts}}
    )
    models = {**tools.models, "dribbleBall": slow}
    speed = found(dataclasses.replace(tools, models=models), trials)["speed"]
    assert speed["free"] == 0.0
    assert speed["explanation"] == "beyond the experience of dribbleBall: v from 0.00 to 0.00"


def test_an_action_without_a_model_is_reported(tools: Toolset, trials: list[Trial]) -> None:
    models = {"goToPose": tools.models["goToPose"]}
    yaw = found(dataclasses.replace(tools, models=models), trials)["yaw"]
    assert yaw["explanation"].startswith("of unknown effect: step 2 (dribbleBall)")


def test_a_gate_that_rejects_everything_is_reported(tools: Toolset, trials: list[Trial]) -> None:
    models = {name: uncertain(model) for name, model in tools.models.items()}
    yaw = found(dataclasses.replace(tools, models=models), trials)["yaw"]
    assert yaw["explanation"].startswith("the gate refuses all gains, of ")


@pytest.mark.parametrize(
    "file", sorted((DOCS / "studies").glob("*.json")), ids=lambda file: file.stem
)
def test_a_published_study_is_shown(file: Path) -> None:
    assert f"{file.stem}: actions and their refinement" in study_page(
        {"variables": [], **read_json(file)}
    )
