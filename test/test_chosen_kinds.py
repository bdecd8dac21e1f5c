"""Kinds of ideal motions that are chosen for a robot are kept with its models."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from experience_rows import made_up_experience
from robots import FIFTH, PIONEER
from stored import episodes, stored

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.experience.store_reading import read_records
from ator_ros.experience.table import Experience, write_experience
from ator_ros.learning.improving import improved
from ator_ros.performance.features import feature_table
from ator_ros.performance.kinds import chosen_for, kinds_of, with_kinds
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.model_file import ModelFileError, load_model, save_model
from ator_ros.performance.training import direct_of, train
from ator_ros.resources import resource_path
from ator_ros.tools import train as tool
from ator_ros.tools.work import train as work

FIFTH_FILE = Path(__file__).parent / "fifth.yaml"
CHOSEN = chosen_for(SOCCER.candidates("goToPose"), FIFTH)


def rows_by_ideal_time() -> pd.DataFrame:
    """Return episodes that take a little longer than the ideal motions of the chosen kinds."""
    rows = made_up_experience("goToPose")
    ideal = next(feature for feature in CHOSEN if feature.ideal and feature.kinds)
    durations = 0.2 + 1.1 * feature_table(direct_of(rows), FIFTH, [ideal])[:, 0]
    return rows.assign(duration=durations, time_to_go=durations, success=True)


ROWS = rows_by_ideal_time()


@pytest.fixture(scope="module")
def model() -> PerformanceModel:
    return train("goToPose", ROWS, FIFTH, features=CHOSEN)


@pytest.fixture
def file(model: PerformanceModel, tmp_path: Path) -> Path:
    save_model(tmp_path / "goToPose.json", model)
    return tmp_path / "goToPose.json"


def durations(model: PerformanceModel) -> np.ndarray:
    found = model.predict(direct_of(ROWS)).duration
    assert found is not None
    return found


def test_only_ideal_motions_are_made_of_kinds() -> None:
    own = SOCCER.candidates("goToPose")
    assert [feature.name for feature in CHOSEN] == [feature.name for feature in own]
    changed = {new.name for new, old in zip(CHOSEN, own, strict=True) if new is not old}
    assert changed == {"drive_time", "drive_turn"}
    assert set(kinds_of(CHOSEN)) == {"drive", "approach"}
    assert kinds_of(own) == {}


def test_a_loaded_model_has_the_kinds_that_it_was_learned_with(model: PerformanceModel, file: Path) -> None:
    loaded = load_model(file, FIFTH, SOCCER.known_features)
    assert np.array_equal(durations(loaded), durations(model))
    assert kinds_of(loaded.features.values()) == kinds_of(model.features.values())
    save_model(file.parent / "again.json", loaded)
    assert (file.parent / "again.json").read_bytes() == file.read_bytes()


def test_without_its_kinds_it_would_predict_something_else(model: PerformanceModel, file: Path) -> None:
    data = json.loads(file.read_text())
    del data["kinds"]
    file.write_text(json.dumps(data))
    few = load_model(file, FIFTH, SOCCER.known_features)
    assert not np.array_equal(durations(few), durations(model))


@pytest.mark.parametrize(
    ("kinds", "message"),
    [
        ([], r"kinds: expected kinds of motion by family, got \[\]"),
        ({"drive": []}, r"kinds.drive: expected 1 to 120 kinds of motion, got \[\]"),
        ({"drive": 3}, "kinds.drive: expected 1 to 120 kinds of motion, got 3"),
        ({"drive": [[0.5, 0.5, True, 0.0]] * 121}, "kinds.drive: expected 1 to 120 kinds"),
        ({"drive": [[1.0]]}, r"kinds.drive.0: expected 4 numbers .*\(first, last, backward, share\), got"),
        ({"drive": [[1.0, "a", False, 0.0]]}, "kinds.drive.0: expected 4 numbers from -1 to 1"),
        ({"drive": [[0.5, 0.5, True, 0.0], [9.0, 0.5, True, 0.0]]}, "kinds.drive.1: expected 4 numbers"),
        ({"drive": [[None, 0.5, True, 0.0]]}, "kinds.drive.0: expected 4 numbers"),
        ({"dribble": [[0.1] * 7]}, "kinds: expected those of the file's features, none, got"),
    ],
)
def test_kinds_that_are_none_are_refused(file: Path, kinds: Any, message: str) -> None:
    data = json.loads(file.read_text())
    data["kinds"] = kinds
    file.write_text(json.dumps(data))
    with pytest.raises(ModelFileError, match=f"goToPose.json: {message}"):
        load_model(file, FIFTH, SOCCER.known_features)


def test_shipped_models_have_the_few_kinds_whatever_the_robot() -> None:
    nearly = dataclasses.replace(PIONEER, limits=dataclasses.replace(PIONEER.limits, v=1.19))
    shipped = resource_path("models", "goToPose.json")
    with pytest.warns(UserWarning, match="ANOTHER ROBOT"):
        loaded = load_model(shipped, nearly, SOCCER.known_features)
    assert kinds_of(loaded.features.values()) == {}


def trained(folder: Path, *words: str) -> dict[str, Any]:
    robot = FIFTH if words else PIONEER
    metadata = {"seed": 1, "robot_digest": robot.digest(), "action_set": "default"}
    write_experience(folder / "a.parquet", Experience(pd.concat([ROWS]), metadata))
    assert tool.main([str(folder / "a.parquet"), "--models", str(folder), *words]) == 0
    read: dict[str, Any] = json.loads((folder / "goToPose.json").read_text())
    return read


def test_train_chooses_kinds_for_robots_other_than_the_domains_own(tmp_path: Path) -> None:
    assert "kinds" not in trained(tmp_path)
    assert set(trained(tmp_path, "--robot", str(FIFTH_FILE))["kinds"]) == {"drive", "approach"}


def test_without_numba_train_says_that_kinds_are_few(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(work, "compiles", lambda: False)
    assert "kinds" not in trained(tmp_path, "--robot", str(FIFTH_FILE))
    assert "without numba few kinds of ideal motions are known" in capsys.readouterr().err


def test_a_round_of_learning_keeps_the_kinds(model: PerformanceModel, tmp_path: Path) -> None:
    stored(tmp_path, episodes(60, seed=4, slower=1.4))
    rows = read_records(tmp_path, "default").rows
    own = SOCCER.candidates("goToPose")
    few = train("goToPose", ROWS, FIFTH, features=own)
    verdict = improved("goToPose", rows, FIFTH, own, now=model, seen={}, former={"shipped": few})
    assert verdict.model is not None
    assert kinds_of(verdict.model.features.values()) == kinds_of(model.features.values())
    others = with_kinds({each.name: each for each in own}, {"drive": [[1.0, 1.0, False, 0.0]]})
    assert set(kinds_of(others.values())) == {"drive"}
