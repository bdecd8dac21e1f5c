"""Performance models as JSON files: plain data that runs no code and survives updates of libraries."""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

from ator_ros.actions import DEFAULT_SET
from ator_ros.files import UnreadableError, is_name, read_json, write_text
from ator_ros.formats import Format
from ator_ros.performance.driving import DrivingStyle
from ator_ros.performance.features import Feature
from ator_ros.performance.kinds import kinds_of, with_kinds
from ator_ros.performance.model import MEASURES, UNOBSERVED, AtGoal, PerformanceModel
from ator_ros.performance.tree.storage import ModelTreeFormatError, tree_from_dict, tree_to_dict
from ator_ros.printable import short, short_path
from ator_ros.resources import resource_path
from ator_ros.robot.description import Robot
from ator_ros.schema import SchemaError, Within, structured

_WITHOUT_KINDS, _WITH_KINDS = 1, 2
FORMAT = Format("ator_ros performance model", _WITH_KINDS, "performance model", {_WITHOUT_KINDS: dict})
"""Files with kinds have a version of their own: older programs would predict something else with them."""
_BESIDE = {"gate", "baselines", "calibration"}
"""Names of other JSON files in a folder of models."""


@dataclass(frozen=True)
class _Accuracy:
    """On fresh episodes, in s; a model of which it was not measured has none."""

    mae_s: Annotated[float, Within(0.0)]
    rmse_s: Annotated[float, Within(0.0)]


@dataclass(frozen=True)
class _ModelFile:
    """The fields of a model file.

    features: unit by name; trees: by measure, see `tree_to_dict`; training: digest of the rows, episodes,
    examples, seed, command; accuracy: empty if not measured; at_goal: left out by models without it.
    """

    action: str
    action_set: str
    robot_digest: str
    features: dict[str, str]
    trees: dict[str, Any]
    training: dict[str, Any]
    versions: dict[str, Any]
    accuracy: dict[str, Any]
    at_goal: AtGoal | None = UNOBSERVED


class ModelFileError(ValueError):
    """A model file that cannot be used; the message names the file, the field and what was expected."""


class NoModelsError(ModelFileError):
    """A folder of models without a single one for an action set."""


class RobotMismatchWarning(UserWarning):
    """A model was learned with another robot than the one that it is to predict for."""


def model_path(action: str, action_set: str = DEFAULT_SET) -> Path:
    """Return the place of a model below models/: goToPose.json, or bezier/goToPose.json for that set.

    Raises
    ------
    ModelFileError
        A name that is no name, and could lead elsewhere.
    """
    for field, name in (("action", action), ("action_set", action_set)):
        if not is_name(name):
            raise ModelFileError(f"{field}: expected a name of letters, digits and _, got {name!r}")
    return Path(action_set if action_set != DEFAULT_SET else "", f"{action}.json")


def models_folder(top: Path, action_set: str = DEFAULT_SET) -> Path:
    """Return the folder below `top` that holds the models of an action set; see `model_path`."""
    return (top / model_path("any", action_set)).parent


def save_model(path: Path | str, model: PerformanceModel) -> None:
    """Write `model` and its metadata, whole or not at all; the same model gives the same bytes.

    Parameters
    ----------
    path : Path or str
        The JSON file.
    model : PerformanceModel
        Its `metadata` gives action_set, training, versions and accuracy.

    Raises
    ------
    ModelFileError
        Another file beside the models has the action's name.
    """
    if model.action in _BESIDE:
        raise ModelFileError(f"action: expected a name other than {model.action}, which another file has")
    names = dict.fromkeys(name for tree in model.trees.values() for name in tree.names)
    kinds = kinds_of(model.features.values())
    data = {
        **FORMAT.head(),
        "schema_version": _WITH_KINDS if kinds else _WITHOUT_KINDS,
        "action": model.action,
        "action_set": model.metadata.get("action_set", DEFAULT_SET),
        "robot_digest": model.metadata.get("robot_digest", model.robot.digest()),
        "features": {name: model.features[name].unit for name in names},
        "training": model.metadata.get("training", {}),
        "versions": model.metadata.get("versions", {}),
        "accuracy": model.metadata.get("accuracy", {}),
        "at_goal": None if model.at_goal is None else asdict(model.at_goal),
        "trees": {measure: tree_to_dict(tree) for measure, tree in model.trees.items()},
    }
    if kinds:
        data["kinds"] = kinds
    if model.driving is not None:
        data["driving"] = model.driving.to_dict()
    write_text(path, json.dumps(data, indent=1, allow_nan=False) + "\n")


def load_model(path: Path | str, robot: Robot, features: Mapping[str, Feature]) -> PerformanceModel:
    """Read a model.

    Parameters
    ----------
    path : Path or str
        The JSON file.
    robot : Robot
        For whose limits features are computed; another one than in learning raises a RobotMismatchWarning.
    features : mapping of str to Feature
        All features that the file may name; see `Domain.known_features`.

    Raises
    ------
    ModelFileError
        The file is missing, damaged, no model, or newer than this program.
    """
    data, file = _read(path)
    units = {name: features[name].unit for name in file.features if name in features}
    for name, unit in file.features.items():
        if units.get(name) != unit:
            known = f"in {units[name]!r}" if name in units else f"one of {', '.join(features)}"
            raise ModelFileError(f"{path}: features.{name}: expected a feature {known}, got unit {unit!r}")
    trees = {}
    for measure, tree in file.trees.items():
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
    _check_starts(path, file.training.get("starts", {}))
    if file.robot_digest != robot.digest():
        _warn_of_robot(path, file, robot)
    apart = ("format", "trees", "kinds", "driving", "at_goal")
    metadata = {name: value for name, value in data.items() if name not in apart}
    made = _made(path, features, data["kinds"]) if "kinds" in data else {}
    named = {**{name: features[name] for name in units}, **made}
    return PerformanceModel(file.action, robot, trees, named, metadata, _driving(path, data), file.at_goal)


def _made(path: Path | str, features: Mapping[str, Feature], kinds: Any) -> dict[str, Feature]:
    """Return the features that are made of the kinds in a file, also those that no tree of it names."""
    if not isinstance(kinds, dict):
        raise ModelFileError(f"{path}: kinds: expected kinds of motion by family, got {short(kinds)}")
    try:
        made = {name: each for name, each in with_kinds(features, kinds).items() if each.kinds}
    except ValueError as error:
        raise ModelFileError(f"{path}: kinds.{error}") from error
    known = kinds_of(made.values())
    if not known or set(known) != set(kinds):
        raise ModelFileError(f"{path}: kinds: expected families of motion, got {short(kinds)}")
    return made


def _check_starts(path: Path | str, starts: Any) -> None:
    """Raise ModelFileError unless experience is told as ranges, each of its least and its greatest number."""
    if not isinstance(starts, dict):
        raise ModelFileError(f"{path}: training.starts: expected ranges by name, got {short(starts)}")
    for name, bounds in starts.items():
        numbers = isinstance(bounds, list) and len(bounds) == 2 and all(map(_is_finite, bounds))
        if not numbers or bounds[0] > bounds[1] or (name == "braking" and bounds[0] < 0.0):
            raise ModelFileError(
                f"{path}: training.starts.{short_path(name)}: expected a least and a greatest number, "
                f"got {short(bounds)}"
            )


def _is_finite(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def load_models(
    robot: Robot,
    features: Mapping[str, Feature],
    *,
    action_set: str = DEFAULT_SET,
    folder: Path | None = None,
) -> dict[str, PerformanceModel]:
    """Read all models of an action set.

    Parameters
    ----------
    robot : Robot
    features : mapping of str to Feature
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
    place = models_folder(top, action_set)
    files = filter(is_model, sorted(place.glob("*.json")))
    models = {file.stem: load_model(file, robot, features) for file in files}
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
    return file.stem not in _BESIDE


def _read(path: Path | str) -> tuple[dict[str, Any], _ModelFile]:
    """Return the file's fields as they are, which a model carries along, and as their schema."""
    if not Path(path).exists():
        raise ModelFileError(f"{path}: expected a model, there is no such file: run train to make it")
    try:
        data = FORMAT.current(read_json(Path(path), parse_constant=_refuse_constant))
        file = structured(data, _ModelFile)
        if file.accuracy:
            structured(file.accuracy, _Accuracy, "accuracy")
    except UnreadableError as error:
        raise ModelFileError(str(error)) from error
    except SchemaError as error:
        raise ModelFileError(f"{path}: {error}") from error
    return data, file


def _refuse_constant(text: str) -> float:
    raise ValueError(f"expected finite numbers, got {text}")


def _driving(path: Path | str, data: Mapping[str, Any]) -> DrivingStyle | None:
    """Return how the action was observed to drive, None where that was not needed."""
    try:
        return DrivingStyle.from_dict(data["driving"]) if data.get("driving") is not None else None
    except ValueError as error:
        raise ModelFileError(f"{path}: driving: {error}") from error


def _warn_of_robot(path: Path | str, file: _ModelFile, robot: Robot) -> None:
    warnings.warn(
        f"{path}: robot_digest: this model of {file.action} was learned with ANOTHER ROBOT "
        f"({file.robot_digest}) than {robot.name} ({robot.digest()}): its predictions may be wrong. "
        "Run collect and train with this robot's config.",
        RobotMismatchWarning,
        stacklevel=3,
    )
