"""References for the learned models: ideal times without learning, and gradient boosting."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
from sklearn.ensemble import HistGradientBoostingRegressor

from ator_ros.geometry import FloatArray
from ator_ros.performance.derived import Geometry
from ator_ros.performance.features import FEATURES, PATHS, derived_from, feature_table, names_of
from ator_ros.performance.training import direct_of
from ator_ros.robot.description import Robot

START_WEIGHT = 20.0
"""Weight of the start of an episode; its other rows weigh 1."""


@dataclass(frozen=True)
class IdealTime:
    """Predicts an ideal time at the robot's limits, without learning.

    Attributes
    ----------
    robot : Robot
        Its limits, and the position of its hold.
    feature : str
        A feature that depends on the same direct variables.
    compute : callable
        Returns the time in s, shape (n,).
    """

    robot: Robot
    feature: str
    compute: Callable[[Geometry], FloatArray]

    @property
    def used_variables(self) -> frozenset[str]:
        """Direct variables that the time depends on."""
        return derived_from([self.feature])

    def predict(self, direct: Mapping[str, Any], measures: tuple[str, ...] = ()) -> Any:  # noqa: ARG002
        """Return the duration in s, shape (n,), and nothing else."""
        return SimpleNamespace(duration=self.compute(Geometry(direct, self.robot)))


def ideal_times(robot: Robot) -> dict[str, IdealTime]:
    """Return by action the ideal time that is also a feature of the learned models."""
    return {
        "goToPose": IdealTime(robot, "drive_time", lambda geometry: geometry.drive.time),
        "dribbleBall": IdealTime(robot, "dribble_time", lambda geometry: geometry.dribble.time),
        "shoot": IdealTime(robot, "shot_time", lambda geometry: geometry.shot.time),
    }


def plain_times(robot: Robot) -> dict[str, IdealTime]:
    """Return by action the time to turn, drive straight and turn again at the robot's limits.

    The drive may go backward unless the ball is held. For a shot: turn toward the goal and drive.
    """

    def either_way(geometry: Geometry) -> FloatArray:
        return np.minimum(geometry.turn_drive_turn(), geometry.turn_drive_turn(reverse=True))

    return {
        "goToPose": IdealTime(robot, "turn_drive_turn", either_way),
        "dribbleBall": IdealTime(robot, "turn_drive_turn", lambda geometry: geometry.turn_drive_turn()),
        "shoot": IdealTime(robot, "hold_angle", _turn_and_drive),
    }


def _turn_and_drive(geometry: Geometry) -> FloatArray:
    limits = geometry.robot.limits
    return np.abs(geometry.hold_angle) / limits.w + geometry.hold_dist / limits.v


class BoostedTime:
    """Predicts durations with histogram gradient boosting over all described features; not a readable model.

    Parameters
    ----------
    robot : Robot
        Its limits, and the position of its hold.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.names = tuple(name for name in FEATURES if name not in names_of(PATHS))
        self.used_variables = derived_from(self.names)
        self._boosting = HistGradientBoostingRegressor(max_iter=250, learning_rate=0.08, random_state=0)

    def fit(self, rows: pd.DataFrame) -> BoostedTime:
        """Fit to the rows of one action of a table of experience; starts have the weight START_WEIGHT."""
        # Samples at 1 Hz: more of the same episodes take time and add little.
        sampled = np.isclose(rows["t"] % 1.0, 0.0, atol=0.01)
        good = rows[rows["success"] & sampled]
        table = feature_table(direct_of(good), self.robot, self.names)
        weight = np.where(good["t"] == 0.0, START_WEIGHT, 1.0)
        self._boosting.fit(table, good["time_to_go"].to_numpy(dtype=float), sample_weight=weight)
        return self

    def predict(self, direct: Mapping[str, Any], measures: tuple[str, ...] = ()) -> Any:  # noqa: ARG002
        """Return the duration in s, shape (n,), and nothing else."""
        return SimpleNamespace(duration=self._boosting.predict(feature_table(direct, self.robot, self.names)))
