"""Model files: stored content and rejected files."""

import dataclasses
import json
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from experience_rows import synthetic_experience

from ator_ros.bases.description import load_robot
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.files import FileError
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.model_file import (
    NoModelsError,
    RobotMismatchWarning,
    load_model,
    load_models,
    model_path,
    save_model,
)
from ator_ros.performance.training import direct_of, train

ROBOT = load_robot()
ROWS = synthetic_experience("goToPose")


@pytest.fixture(scope="module")
def model() -> PerformanceModel:
    learned = train("goToPose", ROWS, ROBOT)
    metadata = {
        "action_set": "default",
        "training": {"seed": 1},
        "accuracy": {"mae_s": 0.1, "rmse_s": 0.2},
    }
    return dataclasses.replace(learned, metadata=metadata)


@pytest.fixture
def file(model: PerformanceModel, tmp_path: Path) -> Path:
    path = tmp_path / "goToPose.json"
    save_model(path, model)
    return path


def test_a_loaded_model_predicts_the_same_to_the_last_bit(
    model: PerformanceModel, file: Path
) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        loaded = load_model(file, ROBOT, SOCCER.known_features)
    measures = tuple(model.trees)
    before, after = (m.predict(direct_of(ROWS), measures) for m in (model, loaded))
    assert all(np.array_equal(getattr(before, name), getattr(after, name)) for name in measures)
    assert loaded.used_variables == model.used_variables
    assert loaded.metadata["training"] == {"seed": 1}
    assert loaded.metadata["accuracy"]["mae_s"] == 0.1


def test_learning_twice_gives_the_same_bytes(
    model: PerformanceModel, file: Path, tmp_path: Path
) -> None:
    again = dataclasses.replace(train("goToPose", ROWS.copy(), ROBOT), metadata=model.metadata)
    save_model(tmp_path / "again.json", again)
    assert (tmp_path / "again.json").read_bytes() == file.read_bytes()


def test_a_model_of_another_robot_raises_a_warning(file: Path) -> None:
    other = dataclasses.replace(ROBOT, mass=12.0)
    with pytest.warns(RobotMismatchWarning, match="ANOTHER ROBOT"):
        load_model(file, other, SOCCER.known_features)


def without(name: str) -> Callable[[dict[str, Any]], object]:
    return lambda data: data.pop(name)


def put(*path: Any) -> Callable[[dict[str, Any]], object]:
    *parents, last, value = path

    def change(data: Any) -> None:
        for key in parents:
            data = data[key]
        data[last] = value

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (without("trees"), "expected the fields .*; missing trees"),
        (put("features", "mood", "m"), r"features\.mood: expected a feature one of "),
        (lambda data: data["trees"].pop("duration"), r"trees\.duration: expected a tree; got None"),
        (
            put("trees", "duration", "root", "samples", "many"),
            r"trees\.duration\.root\.samples: expected",
        ),
        (
            put("training", "starts", {"braking": [0.0, -1.0]}),
            r"training\.starts\.braking: expected a least",
        ),
        (put("driving", "limits", "v", 100.0), r"driving\.limits\.v: expected .* to 20"),
        (put("features", {}), r"trees\.duration\.features: expected features that the file lists"),
    ],
)
def test_damaged_foreign_and_newer_files_are_rejected(
    file: Path, change: Callable[[dict[str, Any]], object], message: str
) -> None:
    data = json.loads(file.read_text())
    change(data)
    file.write_text(json.dumps(data))
    with pytest.raises(FileError, match=rf"goToPose\.json: {message}"):
        load_model(file, ROBOT, SOCCER.known_features)


def test_a_missing_file_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"none\.json: .* no such file: run train to make it$"):
        load_model(tmp_path / "none.json", ROBOT, SOCCER.known_features)


def test_action_sets_have_separate_folders(model: PerformanceModel, tmp_path: Path) -> None:
    save_model(tmp_path / model_path("goToPose"), model)
    bezier = dataclasses.replace(model, metadata={**model.metadata, "action_set": "bezier"})
    save_model(tmp_path / model_path("goToPose", "bezier"), bezier)
    assert list(load_models(ROBOT, SOCCER.known_features, folder=tmp_path)) == ["goToPose"]
    bezier = load_models(ROBOT, SOCCER.known_features, action_set="bezier", folder=tmp_path)
    assert list(bezier) == ["goToPose"]
    with pytest.raises(NoModelsError, match="run train to make them"):
        load_models(ROBOT, SOCCER.known_features, action_set="other", folder=tmp_path)
    with pytest.raises(FileError, match="expected a folder of models") as caught:
        load_models(ROBOT, SOCCER.known_features, folder=tmp_path / "none")
    assert not isinstance(caught.value, NoModelsError)
