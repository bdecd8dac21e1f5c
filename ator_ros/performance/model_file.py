"""Performance models as JSON files.

The files are plain data: they run no code and survive updates of libraries.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from ator_ros.actions import DEFAULT_SET
from ator_ros.bases.description import Robot
from ator_ros.bases.interface import Driving
from ator_ros.files import FileError, is_name, load, save
from ator_ros.performance.error_process import ErrorProcess
from ator_ros.performance.features import ROUTE_FEATURES, Feature, base_features, names_of
from ator_ros.performance.held_up import NOT_HELD_UP, HeldUp
from ator_ros.performance.model import MEASURES, Arrival, AtGoal, Passing, PerformanceModel
from ator_ros.performance.tree.storage import StoredTree, restored, stored
from ator_ros.printable import printable, quoted
from ator_ros.resources import resource_path
from ator_ros.schema import Must, SchemaError, require, structured, unstructured

KIND = "performance model"


@dataclass(frozen=True)
class _ModelFile:
    """The fields of a model file: `features` are units by name, `accuracy` may be empty."""

    action: str
    action_set: str
    robot_digest: str
    features: dict[str, str]
    training: dict[str, Any]
    versions: dict[str, Any]
    accuracy: dict[str, Any]
    at_goal: AtGoal | None
    trees: dict[
        Annotated[str, Must(f"one of {', '.join(MEASURES)}", MEASURES.__contains__)],
        StoredTree,
    ]
    errors: ErrorProcess | None
    driving: dict[str, Any] | None = None
    arrival: Arrival | None = None
    held_up: HeldUp | None = None
    passing: Passing | None = None

    def __post_init__(self) -> None:
        """Check what depends on several fields, and numbers that are read later."""
        require("duration" in self.trees, "trees.duration", "a tree", None)
        listed = "features that the file lists"
        for measure, tree in self.trees.items():
            unknown = sorted(set(tree.features) - self.features.keys())
            require(not unknown, f"trees.{measure}.features", listed, unknown)
        used = self.errors.features if self.errors is not None else ()
        unknown = sorted(set(used) - self.features.keys())
        require(not unknown, "errors.features", listed, unknown)
        starts = self.training.get("starts", {})
        require(isinstance(starts, dict), "training.starts", "ranges by name", starts)
        for name, bounds in starts.items():
            place = f"training.starts.{printable(name)}"
            require(_is_range(bounds), place, "a least and a greatest number", bounds)
        for name in ("mae_s", "rmse_s") if self.accuracy else ():
            value = self.accuracy.get(name)
            require(_is_finite(value), f"accuracy.{name}", "a finite number", value)


class NoModelsError(FileError):
    """A folder has no model for an action set."""


class OtherBaseError(NoModelsError):
    """A model was learned with a robot of another kind of base: it is none of this robot."""


class RobotMismatchWarning(UserWarning):
    """A model was learned with another robot than the one that it predicts for."""


def model_path(action: str, action_set: str = DEFAULT_SET) -> Path:
    """Return the place of a model below models/.

    It is goToPose.json in the default action set, bezier/goToPose.json in the set "bezier".

    Raises
    ------
    FileError
        A name has characters other than letters, digits and _, which could lead elsewhere.
    """
    for field, name in (("action", action), ("action_set", action_set)):
        if not is_name(name):
            raise FileError(f"{field}: expected a name of letters, digits and _, got {name!r}")
    return Path(action_set if action_set != DEFAULT_SET else "", f"{action}.json")


def models_folder(top: Path, action_set: str = DEFAULT_SET) -> Path:
    """Return the folder below `top` with the models of an action set; see `model_path`.

    Raises FileError for an invalid name.
    """
    return (top / model_path("any", action_set)).parent


def save_model(path: Path | str, model: PerformanceModel) -> None:
    """Write a model, with action_set, training, versions and accuracy of its metadata.

    The file is replaced in one step, so that a reader never gets half of it.
    """
    names: dict[str, None] = {}
    for tree in model.trees.values():
        names |= dict.fromkeys(tree.names)
    if model.errors is not None:
        names |= dict.fromkeys(model.errors.features)
    file = _ModelFile(
        action=model.action,
        action_set=model.metadata.get("action_set", DEFAULT_SET),
        robot_digest=model.metadata.get("robot_digest", model.robot.digest()),
        features={name: model.features[name].unit for name in names},
        training=model.metadata.get("training", {}),
        versions=model.metadata.get("versions", {}),
        accuracy=model.metadata.get("accuracy", {}),
        at_goal=model.at_goal,
        trees={measure: stored(tree) for measure, tree in model.trees.items()},
        driving=None if model.driving is None else unstructured(model.driving),
        errors=model.errors,
        arrival=model.arrival,
        held_up=None if model.held_up == NOT_HELD_UP else model.held_up,
        passing=model.passing,
    )
    save(path, KIND, file, compact=("errors",))


def load_model(
    path: Path | str,
    robot: Robot,
    features: Mapping[str, Feature],
) -> PerformanceModel:
    """Read a model.

    Warns with a RobotMismatchWarning if the model was learned with another robot.

    Parameters
    ----------
    path : Path or str
        The file.
    robot : Robot
        The robot to predict for.
    features : mapping of str to Feature
        All features that the file may name; see `Domain.known_features`.

    Raises
    ------
    FileError
        The file is missing, damaged, no model, or of another version, or the model is of a robot
        with another kind of base (`OtherBaseError`).
    """
    if not Path(path).exists():
        raise FileError(f"{path}: expected a model, there is no such file: run train to make it")
    file = load(path, KIND, _ModelFile)
    features = {**{item.name: item for item in base_features(robot.driving)}, **features}
    units = {name: features[name].unit for name in file.features if name in features}
    of_routes = set(names_of(ROUTE_FEATURES))
    if of_routes.isdisjoint(features) and not of_routes.isdisjoint(file.features):
        raise FileError(
            f"{path}: features: expected a map, as this model was learned with one, got none: "
            "set the node's parameter map, or --map, to the map_server file of the building"
        )
    for name, unit in file.features.items():
        if units.get(name) != unit:
            known = f"in {units[name]!r}" if name in units else f"one of {', '.join(features)}"
            raise FileError(
                f"{path}: features.{name}: expected a feature {known}, got unit {quoted(unit)}"
            )
    driving = _driving_of(file, robot, path)
    if file.robot_digest != robot.digest():
        warnings.warn(
            f"{path}: robot_digest: this model of {file.action} was learned with ANOTHER ROBOT "
            f"({file.robot_digest}) than {robot.name} ({robot.digest()}): its predictions may be "
            "wrong. Run collect and train with this robot's config.",
            RobotMismatchWarning,
            stacklevel=2,
        )
    named = {name: features[name] for name in units}
    names = ("action", "action_set", "robot_digest", "training", "versions", "accuracy")
    metadata = {name: getattr(file, name) for name in names}
    trees = {measure: restored(tree) for measure, tree in file.trees.items()}
    return PerformanceModel(
        file.action,
        robot,
        trees,
        named,
        metadata,
        driving=driving,
        at_goal=file.at_goal,
        errors=file.errors,
        arrival=file.arrival,
        held_up=file.held_up or NOT_HELD_UP,
        passing=file.passing,
    )


def _driving_of(file: _ModelFile, robot: Robot, path: Path | str) -> Driving | None:
    if file.driving is None:
        return None
    try:
        return structured(file.driving, robot.driving)
    except SchemaError as error:
        if file.robot_digest != robot.digest():
            raise OtherBaseError(
                f"{path}: this model of {file.action} was learned with a robot that drives "
                f"otherwise than {robot.name}: run collect and train with this robot's config"
            ) from error
        raise FileError(f"{path}: driving.{error}") from error


def _is_finite(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _is_range(value: Any) -> bool:
    if not isinstance(value, list | tuple) or len(value) != 2:
        return False
    return all(map(_is_finite, value)) and value[0] <= value[1]


def load_models(
    robot: Robot,
    features: Mapping[str, Feature],
    *,
    action_set: str = DEFAULT_SET,
    folder: Path | None = None,
) -> dict[str, PerformanceModel]:
    """Read all models of an action set, by action.

    Parameters
    ----------
    robot : Robot
        The robot to predict for.
    features : mapping of str to Feature
        All features that the files may name.
    action_set : str
        Name of the action set.
    folder : Path, optional
        Folder of the models of all action sets; by default the shipped models/.

    Raises
    ------
    NoModelsError
        The action set has no models.
    FileError
        The folder or one of the models cannot be used.
    """
    top = folder if folder is not None else resource_path("models")
    if not top.is_dir():
        raise FileError(f"{top}: expected a folder of models, found none")
    place = models_folder(top, action_set)
    files = sorted(place.glob("*.json"))
    models = {file.stem: load_model(file, robot, features) for file in files}
    if not models:
        raise NoModelsError(
            f"{place}: expected model files such as goToPose.json: run train to make them"
        )
    for name, model in models.items():
        for field, expected in (("action", name), ("action_set", action_set)):
            if model.metadata[field] != expected:
                raise FileError(
                    f"{place / name}.json: {field}: expected {expected!r} in this place, "
                    f"got {quoted(model.metadata[field])}"
                )
    return models
