"""The performance models of each action set, read at a node's start, and their state for diagnostics."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rclpy.node import Node

from ator_ros.actions import DEFAULT_SET
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
from ator_ros.refinement import RefinementError
from ator_ros.refinement.calibration import CALIBRATION, Calibration, load_calibration_if_any
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
    lacking : tuple of str
        Actions that could be executed and have no model.
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
    lacking: tuple[str, ...] = ()
    absent: str = ""
    problem: str = ""
    digest: str = ""
    calibration: Calibration = field(default_factory=Calibration)


def read_models(node: Node, robot: Robot, action_set: str, folder: str, domain: Domain) -> ModelSet:
    """Read the models of an action set; log what is wrong.

    Of sets beside the default one, which are seldom used, only damaged files are logged.

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
    log, usual = node.get_logger(), action_set == DEFAULT_SET
    try:
        place = Path(folder) if folder else domain.shipped_models
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", RobotMismatchWarning)
            models = load_models(robot, domain.known_features, action_set=action_set, folder=place)
        digest = _digest(place, action_set, models)
    except NoModelsError as error:
        return ModelSet(absent=str(error))
    except (ModelFileError, OSError) as error:  # a missing resource is one
        log.warning(f"action set {action_set}: no models: {error}")
        return ModelSet(absent=str(error), problem=str(error))
    problem = _summary([str(warning.message) for warning in caught])
    if problem and usual:
        log.warning(f"action set {action_set}: {problem}")
    files = models_folder(place, action_set)
    usable = {top.action for top in domain.library(robot, action_set).usable()}
    lacking = tuple(sorted(usable - models.keys()))
    calibration = _calibration(node, files, action_set, models)
    return ModelSet(place, models, lacking=lacking, problem=problem, digest=digest, calibration=calibration)


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
    if action_set == DEFAULT_SET and (
        others := sorted(models.keys() & read.shortfalls.keys() - matching.shortfalls.keys())
    ):
        node.get_logger().warning(
            f"action set {action_set}: predictions of {', '.join(others)} are not corrected: "
            f"{folder / CALIBRATION} was learned for other models; `calibrate_predictions` learns it anew"
        )
    return matching


def _digest(folder: Path, action_set: str, models: Mapping[str, PerformanceModel]) -> str:
    """Return a short digest of the files of models."""
    files = sorted(folder / model_path(name, action_set) for name in models)
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:16]


def startup_text(sets: Mapping[str, ModelSet], source: str) -> str:
    """Return what a node logs of its models at the start: those of the default action set.

    Parameters
    ----------
    sets : mapping of str to ModelSet
        The models of each action set.
    source : str
        Where they come from.
    """
    read = sets[DEFAULT_SET]
    if not read.models:
        return f"no models ({read.absent})"
    none = f", none of {', '.join(read.lacking)}" if read.lacking else ""
    return f"{source}: {', '.join(read.models)}{none}"


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
