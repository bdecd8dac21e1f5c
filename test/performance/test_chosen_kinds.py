"""Kinds of ideal motions chosen for a robot are stored with its models."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from experience_rows import synthetic_experience
from robots import FIFTH, PIONEER

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.experience.table import Experience, write_experience
from ator_ros.files import FileError
from ator_ros.performance.features import chosen_for, feature_table, kinds_of
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.model_file import load_model, save_model
from ator_ros.performance.training import direct_of, train
from ator_ros.resources import resource_path
from ator_ros.tools import train as tool

FIFTH_FILE = Path(__file__).parents[1] / "fifth.yaml"
CHOSEN = chosen_for(SOCCER.candidates("goToPose"), FIFTH)


def rows_by_ideal_time() -> pd.DataFrame:
    """Return episodes slightly longer than the ideal motions of the chosen kinds."""
    rows = synthetic_experience("goToPose")
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


def test_a_loaded_model_has_the_kinds_of_its_training(model: PerformanceModel, file: Path) -> None:
    loaded = load_model(file, FIFTH, SOCCER.known_features)
    assert np.array_equal(durations(loaded), durations(model))
    assert kinds_of(loaded.features.values()) == kinds_of(model.features.values())
    save_model(file.parent / "again.json", loaded)
    assert (file.parent / "again.json").read_bytes() == file.read_bytes()


@pytest.mark.parametrize(
    ("kinds", "message"),
    [
        ([], r"kinds: expected a table; got \[\]"),
        ({"waltz": [[1.0]]}, "kinds: expected families of motion, got .'waltz'"),
        ({"drive": [[1.0]]}, r"kinds.drive.0: expected 4 values \(first, last, backward, share\), got"),
    ],
)
def test_invalid_kinds_are_rejected(file: Path, kinds: Any, message: str) -> None:
    data = json.loads(file.read_text())
    data["kinds"] = kinds
    file.write_text(json.dumps(data))
    with pytest.raises(FileError, match=f"goToPose.json: {message}"):
        load_model(file, FIFTH, SOCCER.known_features)


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


def test_models_of_another_robot_do_not_replace_shipped_ones(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    metadata = {"seed": 1, "robot_digest": FIFTH.digest(), "action_set": "default"}
    write_experience(tmp_path / "a.parquet", Experience(ROWS, metadata))
    before = resource_path("models", "goToPose.json").read_bytes()
    assert tool.main([str(tmp_path / "a.parquet"), "--robot", str(FIFTH_FILE)]) == 1
    assert "--models: expected a folder for models of fifth" in capsys.readouterr().err
    assert resource_path("models", "goToPose.json").read_bytes() == before
