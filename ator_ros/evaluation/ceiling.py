"""Rulers for the learned models: the ideal time without learning, and gradient boosting as their ceiling."""

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
from ator_ros.performance.features import FEATURES, derived_from, feature_table
from ator_ros.performance.training import direct_of
from ator_ros.robot.description import Robot

START_WEIGHT = 20.0
"""How many rows the start of an episode counts as."""


@dataclass(frozen=True)
class IdealTime:
    """Predicts an ideal time at the robot's limits: nothing is learned.

    Attributes
    ----------
    robot : Robot
        Limits, and where a ball is held.
    feature : str
        A feature that derives from the same direct variables.
    compute : callable
        Gives the time in s.
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
    """Return by action the time of the best of the motions that the learned models know as features."""
    return {
        "goToPose": IdealTime(robot, "drive_time", lambda geometry: geometry.drive.time),
        "dribbleBall": IdealTime(robot, "dribble_time", lambda geometry: geometry.dribble.time),
        "shoot": IdealTime(robot, "shot_time", lambda geometry: geometry.shot.time),
    }


def plain_times(robot: Robot) -> dict[str, IdealTime]:
    """Return by action the time of turning, driving and turning again, what one knows of any such robot.

    Only without the ball the drive may go backward. A shot turns toward the goal and drives.
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
    """Predicts durations with histogram gradient boosting over all features: accurate, but no readable model.

    Parameters
    ----------
    robot : Robot
        Limits, and where a ball is held.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.names = tuple(FEATURES)
        self.used_variables = derived_from(self.names)
        self._boosting = HistGradientBoostingRegressor(max_iter=250, learning_rate=0.08, random_state=0)

    def fit(self, rows: pd.DataFrame) -> BoostedTime:
        """Learn from the rows, of one action, of an experience table; a start counts as START_WEIGHT rows."""
        # Samples of 1 Hz beside the starts: more of the same episodes cost time and tell little.
        sampled = np.isclose(rows["t"] % 1.0, 0.0, atol=0.01)
        good = rows[rows["success"] & sampled]
        table = feature_table(direct_of(good), self.robot, self.names)
        weight = np.where(good["t"] == 0.0, START_WEIGHT, 1.0)
        self._boosting.fit(table, good["time_to_go"].to_numpy(dtype=float), sample_weight=weight)
        return self

    def predict(self, direct: Mapping[str, Any], measures: tuple[str, ...] = ()) -> Any:  # noqa: ARG002
        """Return the duration in s, shape (n,), and nothing else."""
        return SimpleNamespace(duration=self._boosting.predict(feature_table(direct, self.robot, self.names)))
