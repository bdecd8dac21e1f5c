"""Performance models as JSON files: plain data that runs no code and survives updates of libraries."""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ator_ros.files import UnreadableError, is_name, read_json, write_text
from ator_ros.performance.driving import DrivingStyle
from ator_ros.performance.features import FEATURES
from ator_ros.performance.model import MEASURES, PerformanceModel
from ator_ros.performance.tree.storage import ModelTreeFormatError, tree_from_dict, tree_to_dict
from ator_ros.resources import resource_path
from ator_ros.robot.description import Robot

FORMAT = "ator_ros performance model"
SCHEMA_VERSION = 1
FIELDS: dict[str, type] = {
    "format": str,
    "schema_version": int,
    "action": str,
    "action_set": str,
    "robot_digest": str,
    "features": dict,
    "trees": dict,
    "training": dict,
    "versions": dict,
    "accuracy": dict,
}
"""The fields of a model file. features: unit by name; trees: by measure, see `tree_to_dict`; training:
digest of the rows, episodes, examples, seed, command; accuracy: on fresh episodes, empty if not measured.
Models that use the times of paths also have "driving", see `DrivingStyle`."""

ACCURACY = ("mae_s", "rmse_s")


class ModelFileError(ValueError):
    """A model file that cannot be used; the message names the file, the field and what was expected."""


class NoModelsError(ModelFileError):
    """A folder of models without a single one for an action set."""


class RobotMismatchWarning(UserWarning):
    """A model was learned with another robot than the one that it is to predict for."""


def model_path(action: str, action_set: str = "default") -> Path:
    """Return the place of a model below models/: goToPose.json, or bezier/goToPose.json for that set.

    Raises
    ------
    ModelFileError
        A name that is no name, and could lead elsewhere.
    """
    for field, name in (("action", action), ("action_set", action_set)):
        if not is_name(name):
            raise ModelFileError(f"{field}: expected a name of letters, digits and _, got {name!r}")
    return Path(action_set if action_set != "default" else "", f"{action}.json")


def save_model(path: Path | str, model: PerformanceModel) -> None:
    """Write `model` and its metadata, whole or not at all; the same model gives the same bytes.

    Parameters
    ----------
    path : Path or str
        The JSON file.
    model : PerformanceModel
        Its `metadata` gives action_set, training, versions and accuracy.
    """
    names = dict.fromkeys(name for tree in model.trees.values() for name in tree.names)
    data = {
        "format": FORMAT,
        "schema_version": SCHEMA_VERSION,
        "action": model.action,
        "action_set": model.metadata.get("action_set", "default"),
        "robot_digest": model.metadata.get("robot_digest", model.robot.digest()),
        "features": {name: FEATURES[name].unit for name in names},
        "training": model.metadata.get("training", {}),
        "versions": model.metadata.get("versions", {}),
        "accuracy": model.metadata.get("accuracy", {}),
        "trees": {measure: tree_to_dict(tree) for measure, tree in model.trees.items()},
    }
    if model.driving is not None:
        data["driving"] = model.driving.to_dict()
    write_text(path, json.dumps(data, indent=1, allow_nan=False) + "\n")


def load_model(path: Path | str, robot: Robot) -> PerformanceModel:
    """Read a model.

    Parameters
    ----------
    path : Path or str
        The JSON file.
    robot : Robot
        For whose limits features are computed; another one than in learning raises a RobotMismatchWarning.

    Raises
    ------
    ModelFileError
        The file is missing, damaged, no model, or newer than this program.
    """
    data = _read(path)
    units = {name: FEATURES[name].unit for name in data["features"] if name in FEATURES}
    for name, unit in data["features"].items():
        if units.get(name) != unit:
            known = f"in {units[name]!r}" if name in units else f"one of {', '.join(FEATURES)}"
            raise ModelFileError(f"{path}: features.{name}: expected a feature {known}, got unit {unit!r}")
    trees = {}
    for measure, tree in data["trees"].items():
        where = f"{path}: trees.{measure}"
        if measure not in MEASURES:
            raise ModelFileError(f"{where}: expected one of the measures {', '.join(MEASURES)}")
        try:
            trees[measure] = tree_from_dict(tree)
        except ModelTreeFormatError as error:
            raise ModelFileError(f"{where}: {error}") from error
        unknown = set(trees[measure].names) - set(units)
        if unknown:
            raise ModelFileError(
                f"{where}.features: expected features that the file lists, got {sorted(unknown)}"
            )
    if "duration" not in trees:
        raise ModelFileError(f"{path}: trees.duration: expected a tree, found none")
    _check_accuracy(path, data["accuracy"])
    if data["robot_digest"] != robot.digest():
        _warn_of_robot(path, data, robot)
    metadata = {name: value for name, value in data.items() if name not in ("format", "trees", "driving")}
    return PerformanceModel(data["action"], robot, trees, metadata, _driving(path, data))


def load_models(
    robot: Robot, *, action_set: str = "default", folder: Path | None = None
) -> dict[str, PerformanceModel]:
    """Read all models of an action set.

    Parameters
    ----------
    robot : Robot
        As for `load_model`.
    action_set : str
        Name of the set.
    folder : Path, optional
        By default the shipped models/.

    Returns
    -------
    dict
        Models by the names of their actions.

    Raises
    ------
    NoModelsError
        There are none.
    ModelFileError
        One of them cannot be used, or `folder` is none.
    """
    top = folder if folder is not None else resource_path("models")
    if not top.is_dir():
        raise ModelFileError(f"{top}: expected a folder of models, found none")
    place = top / model_path("any", action_set).parent
    models = {file.stem: load_model(file, robot) for file in sorted(place.glob("*.json")) if is_model(file)}
    if not models:
        raise NoModelsError(f"{place}: expected model files such as goToPose.json: run train to make them")
    for name, model in models.items():
        for field, expected in (("action", name), ("action_set", action_set)):
            if model.metadata[field] != expected:
                raise ModelFileError(
                    f"{place / name}.json: {field}: expected {expected!r} in this place, "
                    f"got {model.metadata[field]!r}"
                )
    return models


def is_model(file: Path) -> bool:
    """Return whether `file` is named as models are: other files, such as the gate's, may lie beside them."""
    return not file.stem.startswith(("gate", "baselines", "calibration"))


def _read(path: Path | str) -> dict[str, Any]:
    try:
        data = read_json(Path(path), parse_constant=_refuse_constant)
    except UnreadableError as error:
        raise ModelFileError(str(error)) from error
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise ModelFileError(f"{path}: format: expected {FORMAT!r}: this is no performance model of ator_ros")
    version = data.get("schema_version")
    if type(version) is not int or not 1 <= version <= SCHEMA_VERSION:
        raise ModelFileError(
            f"{path}: schema_version: expected 1 to {SCHEMA_VERSION}, got {version!r}; "
            "a newer one needs a newer ator_ros"
        )
    for name, kind in FIELDS.items():
        if not isinstance(data.get(name), kind):
            got = f"got {type(data[name]).__name__}" if name in data else "it is missing"
            raise ModelFileError(f"{path}: {name}: expected {kind.__name__}, {got}")
    return data


def _refuse_constant(text: str) -> float:
    raise ValueError(f"expected finite numbers, got {text}")


def _driving(path: Path | str, data: Mapping[str, Any]) -> DrivingStyle | None:
    """Return how the action was observed to drive, None where that was not needed."""
    try:
        return DrivingStyle.from_dict(data["driving"]) if data.get("driving") is not None else None
    except ValueError as error:
        raise ModelFileError(f"{path}: driving: {error}") from error


def _check_accuracy(path: Path | str, accuracy: Mapping[str, Any]) -> None:
    for name in ACCURACY if accuracy else ():
        value = accuracy.get(name)
        if not isinstance(value, int | float) or not math.isfinite(value) or value < 0.0:
            raise ModelFileError(f"{path}: accuracy.{name}: expected a time in s, got {value!r}")


def _warn_of_robot(path: Path | str, data: Mapping[str, Any], robot: Robot) -> None:
    warnings.warn(
        f"{path}: robot_digest: this model of {data['action']} was learned with ANOTHER ROBOT "
        f"({data['robot_digest']}) than {robot.name} ({robot.digest()}): its predictions may be wrong. "
        "Run collect and train with this robot's config.",
        RobotMismatchWarning,
        stacklevel=3,
    )
