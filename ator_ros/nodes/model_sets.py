"""The performance models of each action set, read at a node's start, and their state for diagnostics."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rclpy.node import Node

from ator_ros.domains.domain import Domain
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.model_file import (
    ModelFileError,
    NoModelsError,
    RobotMismatchWarning,
    load_models,
    model_path,
    models_folder,
)
from ator_ros.refinement.calibration import Calibration
from ator_ros.refinement.calibration_file import CALIBRATION, load_calibration_if_any
from ator_ros.refinement.errors import RefinementError
from ator_ros.robot.description import Robot


@dataclass(frozen=True, slots=True)
class ModelSet:
    """The performance models of one action set.

    Attributes
    ----------
    folder : Path
        Folder of the files.
    models : mapping
        Action name to model; empty where there are none.
    absent : str
        Why there are no models; empty where there are some.
    problem : str
        What is wrong with the models: a damaged file, another robot. It is no problem to have none.
    digest : str
        Digest of the files.
    calibration : Calibration
        Corrections of the predictions; empty where none were learned for these models.
    """

    folder: Path = Path()
    models: Mapping[str, PerformanceModel] = field(default_factory=dict)
    absent: str = ""
    problem: str = ""
    digest: str = ""
    calibration: Calibration = field(default_factory=Calibration)


def read_models(node: Node, robot: Robot, action_set: str, folder: str, domain: Domain) -> ModelSet:
    """Read the models of an action set; log once what is wrong or missing.

    Parameters
    ----------
    node : Node
        The node that logs.
    robot : Robot
        The robot that executes the actions.
    action_set : str
        Name of the set.
    folder : str
        Folder of the models of all sets; empty: the models that ship with the domain.
    domain : Domain
        The domain of the actions.
    """
    log = node.get_logger()
    try:
        place = Path(folder) if folder else domain.shipped_models
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", RobotMismatchWarning)
            models = load_models(robot, domain.known_features, action_set=action_set, folder=place)
        digest = _digest(place, action_set, models)
    except NoModelsError as error:
        log.info(f"action set {action_set}: no models: {error}")
        return ModelSet(absent=str(error))
    except (ModelFileError, OSError) as error:  # a missing resource is one
        log.warning(f"action set {action_set}: no models: {error}")
        return ModelSet(absent=str(error), problem=str(error))
    problem = _summary([str(warning.message) for warning in caught])
    if problem:
        log.warning(f"action set {action_set}: {problem}")
    files = models_folder(place, action_set)
    usable = {top.action for top in domain.library(robot, action_set).usable()}
    if lacking := sorted(usable - models.keys()):
        log.info(f"action set {action_set}: no models of {', '.join(lacking)} in {files}")
    calibration = _calibration(node, files, action_set, models)
    return ModelSet(place, models, problem=problem, digest=digest, calibration=calibration)


def _summary(warnings: Sequence[str]) -> str:
    """Return the first warning, and how many more: models of another robot mostly come together."""
    more = f" (and {len(warnings) - 1} more models of this set)" if len(warnings) > 1 else ""
    return warnings[0] + more if warnings else ""


def _calibration(
    node: Node, folder: Path, action_set: str, models: Mapping[str, PerformanceModel]
) -> Calibration:
    """Read the calibration of models; without a usable one, log why and correct nothing."""
    try:
        read = load_calibration_if_any(folder)
    except (RefinementError, OSError) as error:
        node.get_logger().warning(f"action set {action_set}: predictions are not corrected: {error}")
        return Calibration()
    matching = read.matching(models)
    if others := sorted(models.keys() & read.shortfalls.keys() - matching.shortfalls.keys()):
        node.get_logger().warning(
            f"action set {action_set}: predictions of {', '.join(others)} are not corrected: "
            f"{folder / CALIBRATION} was learned for other models; `calibrate_predictions` learns it anew"
        )
    return matching


def _digest(folder: Path, action_set: str, models: Mapping[str, PerformanceModel]) -> str:
    """Return a short digest of the files of models."""
    files = sorted(folder / model_path(name, action_set) for name in models)
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:16]


def told_of(sets: Mapping[str, ModelSet]) -> dict[str, object]:
    """Return the diagnostics of each action set's models."""
    models: dict[str, object] = {
        f"models of {name}": ", ".join(read.models) or read.problem or "no models"
        for name, read in sets.items()
    }
    return models | {f"models digest of {name}": read.digest for name, read in sets.items() if read.digest}


def problems_of(sets: Mapping[str, ModelSet]) -> str:
    """Return the problems of all models in one line; empty if there are none."""
    return "; ".join(f"action set {name}: {read.problem}" for name, read in sets.items() if read.problem)
