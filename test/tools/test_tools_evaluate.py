"""The command line `evaluate`, from small synthetic models to report and result."""

import dataclasses
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from experience_rows import synthetic_model
from refinement_fakes import ROBOT

from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.evaluation.comparison import Settings
from ator_ros.evaluation.running import PARTIAL, earlier_oracle, run_situations
from ator_ros.evaluation.toolset import ToolsetSource
from ator_ros.files import FileError
from ator_ros.performance.model_file import save_model
from ator_ros.tools.evaluate import main

ORACLE = ("--oracle", "4", "--oracle-speeds", "0.4", "--oracle-margin", "0.2")
POLICIES = ["naive", "face_goal", "refined", "gated"]


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("models")
    for action in SOCCER.actions():
        save_model(folder / f"{action}.json", synthetic_model(action, ROBOT))
    return folder


def evaluate(
    models: Path, out: Path, *words: str, situations: int = 3, workers: int = 1
) -> dict[str, Any]:
    options = ["--situations", str(situations), "--jobs", str(workers), "--seed", "405"]
    command = [
        *options,
        "--models",
        str(models),
        "--out",
        str(out),
        "--policies",
        *POLICIES,
        *words,
    ]
    assert main(command) == 0
    data: dict[str, Any] = json.loads((out / "evaluation.json").read_text())
    return data


@pytest.fixture(scope="module")
def finished(models: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    out = tmp_path_factory.mktemp("out")
    return out, evaluate(models, out, *ORACLE)


def test_summary_has_every_field_of_every_policy(finished: tuple[Path, dict[str, Any]]) -> None:
    summary = finished[1]["summary"]
    assert (summary["situations"], summary["seed"]) == (3, 405)
    assert summary["command"].startswith("evaluate --situations 3")
    for name in (*POLICIES, "oracle", "oracle_speed"):
        row = summary[name]
        for field in ("mean_duration_s", "improvement_percent", "mean_gain_higher_percent"):
            assert isinstance(row[field], float)
        assert row["higher"] + row["equal"] + row["lower"] == 3
        low, high = row["improvement_ci95"]
        assert low <= row["improvement_percent"] <= high
        assert {"mean_loss_lower_percent", "oracle_captured_percent", "failures"} <= row.keys()
    assert summary["naive"]["improvement_percent"] == 0.0
    assert summary["oracle"]["improvement_percent"] >= 0.0
    assert summary["oracle_speed"]["mean_duration_s"] <= summary["oracle"]["mean_duration_s"]


def test_report_is_one_file_without_network_or_scripts(
    finished: tuple[Path, dict[str, Any]],
) -> None:
    text = (finished[0] / "report.html").read_text()
    for words in ("Table 1 of the paper", "To repeat this", "533"):
        assert words in text
    assert "<script" not in text
    outside = re.findall(r'(?:src|href)="(?!#|data:)[^"]*"|url\((?!#)[^)]*\)|@import', text)
    assert outside == []


@pytest.mark.long
def test_result_is_the_same_for_any_number_of_workers(
    models: Path, finished: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    again = evaluate(models, tmp_path, *ORACLE, workers=2)
    assert again["runs"] == finished[1]["runs"]
    first = {name: row for name, row in finished[1]["summary"].items() if name != "command"}
    assert {name: row for name, row in again["summary"].items() if name != "command"} == first


@pytest.mark.long
def test_evaluation_continues_after_an_interruption(models: Path, tmp_path: Path) -> None:
    settings = Settings(
        seed=405,
        chain="dribble",
        policies=("naive", "refined"),
        source=ToolsetSource(models=str(models)),
    )
    whole = run_situations(settings, situations=2, folder=tmp_path / "whole")
    run_situations(settings, situations=1, folder=tmp_path / "parts")
    partial = tmp_path / "parts" / PARTIAL
    lines = partial.read_text().splitlines()
    assert len(lines) == 2
    partial.write_text("\n".join([*lines, lines[1][:40]]))
    assert run_situations(settings, situations=2, folder=tmp_path / "parts") == whole
    assert partial.read_text().splitlines()[1] == lines[1]
    with pytest.raises(FileError, match="expected results of the same settings and models"):
        run_situations(
            dataclasses.replace(settings, seed=406), situations=2, folder=tmp_path / "parts"
        )


@pytest.mark.long
def test_the_oracle_of_an_earlier_evaluation_is_taken(
    models: Path,
    finished: tuple[Path, dict[str, Any]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    earlier, whole = finished
    found = evaluate(models, tmp_path / "again", "--oracle-from", str(earlier), situations=2)
    for name in ("oracle", "oracle_speed"):
        assert found["runs"][name]["best"] == whole["runs"][name]["best"][:2]
    assert {"oracle", "oracle_speed"} <= found["summary"].keys()
    assert found["executed"] < whole["executed"] / 2
    assert "the best of the executed headings" in (tmp_path / "again" / "report.html").read_text()
    same = [
        "--models",
        str(models),
        "--oracle-from",
        str(earlier),
        "--out",
        str(tmp_path / "other"),
    ]
    for words, expected in (
        (
            ["--seed", "405", "--situations", "4"],
            "expected an oracle of at least 4 situations, got 3",
        ),
        (["--seed", "406"], "expected an evaluation of {'seed': 406, "),
    ):
        assert main([*same, *words]) == 1
        assert expected in capsys.readouterr().err
    assert not (tmp_path / "other").exists()


Damage = Callable[[dict[str, Any]], object]
DAMAGE: list[Damage] = [
    lambda data: data.pop("settings"),
    lambda data: data.update(settings=[1]),
    lambda data: data["settings"].update(source=None),
    lambda data: data["settings"].pop("seed"),
    lambda data: data.pop("runs"),
    lambda data: data.update(runs=1),
    lambda data: data["runs"].update(oracle=5),
    lambda data: data["runs"]["oracle"].pop("best"),
    lambda data: data["runs"]["oracle"].pop("success"),
    lambda data: data["runs"]["oracle"].update(best=["soon", "late", "x"]),
    lambda data: data["runs"]["oracle"].update(chosen=5),
]
"""Changes of an evaluation that leave no oracle to use."""


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_evaluation_has_no_oracle(
    finished: tuple[Path, dict[str, Any]], models: Path, tmp_path: Path, damage: Damage
) -> None:
    data = json.loads((finished[0] / "evaluation.json").read_text())
    damage(data)
    (tmp_path / "evaluation.json").write_text(json.dumps(data))
    source = ToolsetSource(models=str(models))
    settings = Settings(seed=405, chain="dribble", policies=("naive",), source=source)
    with pytest.raises(FileError, match="expected settings and runs of an evaluation"):
        earlier_oracle(tmp_path, settings, 1)


@pytest.mark.parametrize("line", ["[" * 100_000, "5", "{}", '{"index": [1]}', "\0"])
def test_a_damaged_situation_is_reported(models: Path, tmp_path: Path, line: str) -> None:
    source = ToolsetSource(models=str(models))
    settings = Settings(seed=405, chain="dribble", policies=("naive",), source=source)
    identity = {"settings": dataclasses.asdict(settings), "digest": source.digest()}
    (tmp_path / PARTIAL).write_text(f"{json.dumps(identity)}\n{line}\n")
    with pytest.raises(FileError, match="expected results of the same settings and models"):
        run_situations(settings, situations=1, folder=tmp_path)


def test_action_durations_add_up_and_refined_chains_are_predicted(
    finished: tuple[Path, dict[str, Any]],
) -> None:
    for name in ("naive", "refined", "gated"):
        rows = finished[1]["runs"]["policies"][name]
        assert min(rows["predicted"]) > 0.0
        for actions, duration, success in zip(
            rows["actions"], rows["duration"], rows["success"], strict=True
        ):
            assert not success or sum(actions) == pytest.approx(duration, abs=0.01)
    assert "predicted" not in finished[1]["runs"]["policies"]["face_goal"]  # not chosen by a model
    for name in ("naive", "refined", "gated"):
        assert finished[1]["summary"][name]["prediction"]["chains"] > 0
    assert "predicted minus actual" in (finished[0] / "report.html").read_text()
