"""The command line `study`, from experience to a page."""

import json
from pathlib import Path

import pytest

from ator_ros.bases.description import load_robot
from ator_ros.files import read_json
from ator_ros.resources import resource_path
from ator_ros.tools.study import main

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
