"""The performance models of a domain: learned ones, and path times where there are none."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ator_ros.actions import DEFAULT_SET
from ator_ros.bases.description import Robot
from ator_ros.domains.domain import Domain
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.model_file import NoModelsError, OtherBaseError, load_models
from ator_ros.performance.path_times import path_time_model


def models_for(
    domain: Domain,
    robot: Robot,
    *,
    action_set: str = DEFAULT_SET,
    folder: Path | str | None = None,
) -> dict[str, PerformanceModel]:
    """Return a model of each action of a set, by action.

    An action without a model file has `path_time_model`. So has one whose shipped model is of a
    robot with another kind of base.

    Parameters
    ----------
    domain, robot
        The domain, and the robot to predict for.
    action_set : str
        Name of the action set.
    folder : Path or str, optional
        Folder of the models of all action sets; None or empty: the domain's shipped one, which may
        be missing.

    Raises
    ------
    FileError
        A folder that was given, or one of the models, cannot be used.
    """
    root = domain.models_root(folder)
    learned: Mapping[str, PerformanceModel] = {}
    if folder or root.is_dir():
        try:
            learned = load_models(robot, domain.known_features, action_set=action_set, folder=root)
        except NoModelsError as error:
            if folder and isinstance(error, OtherBaseError):
                raise
    return with_path_times(learned, domain, robot, action_set)


def with_path_times(
    learned: Mapping[str, PerformanceModel], domain: Domain, robot: Robot, action_set: str
) -> dict[str, PerformanceModel]:
    """Return the learned models, and those of path times for the other actions of a set."""
    others = {
        name: path_time_model(name, action_set, robot)
        for name in domain.actions(action_set)
        if name not in learned
    }
    return {**learned, **others}
