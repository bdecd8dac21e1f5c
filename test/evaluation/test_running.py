"""A whole evaluation: parallel, resumed, written, and its oracle used again."""

import dataclasses
from pathlib import Path
from typing import Any

import pytest

from ator_ros.evaluation.comparison import Settings
from ator_ros.evaluation.running import (
    KIND,
    PARTIAL,
    RESULT,
    earlier_oracle,
    run_situations,
    to_columns,
    write_result,
)
from ator_ros.evaluation.toolset import ToolsetSource, tools_of
from ator_ros.files import FileError, load

FIFTH = str(Path(__file__).parents[1] / "fifth.yaml")
SETTINGS = Settings(seed=405, chain="dribble", policies=("naive", "face_goal"))


def record(index: int, naive: float, best: float, *, predicted: bool = True) -> dict[str, Any]:
    row = {"duration": naive, "success": True}
    return {
        "index": index,
        "policies": {
            "naive": row | ({"predicted": naive + 0.5, "spread": 0.3} if predicted else {}),
            "face_goal": {"duration": naive + 1.0, "success": True},
        },
        "oracle": {"best": best, "success": True},
        "executed": 3 + index,
    }


RECORDS = [record(0, 10.0, 9.0), record(1, 12.0, 11.0), record(2, 14.0, 12.5)]


def test_columns_have_the_values_of_all_records() -> None:
    records = [{"a": 1, "b": {"c": 2}}, {"a": 3}, {"b": {"c": 4, "d": 5}}]
    assert to_columns(records) == {
        "a": [1, 3, None],
        "b": {"c": [2, None, 4], "d": [None, None, 5]},
    }
    assert to_columns([]) == {}


def test_a_result_has_the_summary_and_all_runs(tmp_path: Path) -> None:
    result = write_result(tmp_path, SETTINGS, RECORDS, "evaluate --seed 405")
    summary = result["summary"]
    assert (summary["situations"], summary["seed"]) == (3, 405)
    assert summary["command"] == "evaluate --seed 405"
    assert summary["naive"]["mean_duration_s"] == 12.0
    assert summary["naive"]["prediction"]["mean_error_s"] == 0.5
    assert "prediction" not in summary["face_goal"]
    assert result["executed"] == 3 + 4 + 5
    assert result["runs"]["oracle"]["best"] == [9.0, 11.0, 12.5]
    assert result["runs"]["policies"]["face_goal"]["duration"] == [11.0, 13.0, 15.0]
    assert result["digest"] == SETTINGS.source.digest()
    read = load(tmp_path / RESULT, KIND, dict[str, Any])
    assert read["summary"] == summary
    assert read["runs"] == result["runs"]


def test_results_name_files_without_their_folders(tmp_path: Path) -> None:
    source = ToolsetSource(models=str(Path(ToolsetSource().folder()).resolve()))
    settings = dataclasses.replace(SETTINGS, source=source)
    result = write_result(tmp_path, settings, RECORDS, "evaluate")
    assert result["settings"]["source"]["models"] == "models"
    assert result["settings"]["source"]["robot"] == ""


def test_the_oracle_of_an_earlier_evaluation_is_read(tmp_path: Path) -> None:
    write_result(tmp_path, SETTINGS, RECORDS, "evaluate")
    other_policies = dataclasses.replace(SETTINGS, policies=("naive",))
    assert earlier_oracle(tmp_path, other_policies, 2) == [
        {"oracle": {"best": 9.0, "success": True}},
        {"oracle": {"best": 11.0, "success": True}},
    ]
    assert len(earlier_oracle(tmp_path, SETTINGS, 3)) == 3
    with pytest.raises(FileError, match="an oracle of at least 4 situations, got 3"):
        earlier_oracle(tmp_path, SETTINGS, 4)
    others = [
        dataclasses.replace(SETTINGS, seed=406),
        dataclasses.replace(SETTINGS, chain="shoot"),
        dataclasses.replace(SETTINGS, source=ToolsetSource(action_set="bezier")),
        dataclasses.replace(SETTINGS, source=ToolsetSource(domain="drive")),
        dataclasses.replace(SETTINGS, source=ToolsetSource(robot=FIFTH)),
    ]
    for settings in others:
        with pytest.raises(FileError, match="expected an evaluation of "):
            earlier_oracle(tmp_path, settings, 2)


def test_an_evaluation_without_an_oracle_has_none_to_offer(tmp_path: Path) -> None:
    without = [{key: row[key] for key in ("index", "policies", "executed")} for row in RECORDS]
    write_result(tmp_path, SETTINGS, without, "evaluate")
    with pytest.raises(FileError, match="an oracle of at least 1 situations, got 0"):
        earlier_oracle(tmp_path, SETTINGS, 1)


def test_an_interrupted_evaluation_is_continued(tmp_path: Path) -> None:
    settings = dataclasses.replace(SETTINGS, policies=("naive",))
    whole = run_situations(settings, situations=2, folder=tmp_path / "whole")
    assert [row["index"] for row in whole] == [0, 1]
    first = run_situations(settings, situations=1, folder=tmp_path / "parts")
    assert first == whole[:1]
    partial = tmp_path / "parts" / PARTIAL
    lines = partial.read_text().splitlines()
    # A finished situation is not executed again, and half a line is.
    partial.write_text("\n".join([*lines, lines[1][:40]]))
    assert run_situations(settings, situations=2, folder=tmp_path / "parts") == whole
    assert partial.read_text().splitlines()[:2] == lines
    other = dataclasses.replace(settings, seed=406)
    with pytest.raises(FileError, match="expected results of the same settings and models"):
        run_situations(other, situations=2, folder=tmp_path / "parts")


def test_tools_are_read_once_until_a_file_changes(tmp_path: Path) -> None:
    for file in ToolsetSource().folder().glob("*.json"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    source = ToolsetSource(models=str(tmp_path))
    first, digest = tools_of(source), source.digest()
    assert tools_of(source) is first
    assert set(first[0].models) == {"goToPose", "dribbleBall", "shoot"}
    changed = tmp_path / "shoot.json"
    changed.write_bytes(changed.read_bytes() + b"\n")
    assert source.digest() != digest
    assert tools_of(source) is not first
    changed.unlink()
    models = tools_of(source)[0].models
    assert {name: model.is_learned for name, model in models.items()} == {
        "goToPose": True,
        "dribbleBall": True,
        "shoot": False,
    }
    source.require_executable("shoot")
    changed.write_text("{}", encoding="utf-8")
    with pytest.raises(FileError, match=r"shoot\.json: "):
        source.require_executable("shoot")
    source.require_executable("dribble")


def test_the_refiner_has_the_time_limit_as_cost_of_a_failure() -> None:
    tools, _ = tools_of(ToolsetSource())
    assert tools.refiner().failure_cost == tools.domain.time_limit
    assert tools.refiner(gated=True).gate != tools.refiner().gate


def test_the_described_robot_is_that_of_the_file() -> None:
    shipped = ToolsetSource().described()
    other = ToolsetSource(robot=FIFTH)
    assert other.described().name == "fifth" != shipped.name
    assert other.digest() != ToolsetSource().digest()
    assert ToolsetSource(action_set="bezier").digest() != ToolsetSource().digest()
    assert ToolsetSource(action_set="bezier").folder() == ToolsetSource().folder() / "bezier"
