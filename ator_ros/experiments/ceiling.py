"""Rulers for the learned models: the ideal time without learning, and gradient boosting as their ceiling."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType, SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
from sklearn.ensemble import HistGradientBoostingRegressor

from ator_ros.geometry import FloatArray
from ator_ros.performance.derived import Geometry
from ator_ros.performance.features import FEATURES, derived_from, feature_table
from ator_ros.performance.training import direct_of
from ator_ros.robot import Robot

START_WEIGHT = 20.0
"""How many rows the start of an episode counts as."""

IDEAL: Mapping[str, tuple[str, Callable[[Geometry], FloatArray]]] = MappingProxyType(
    {
        "goToPose": ("drive_time", lambda geometry: geometry.drive.time),
        "dribbleBall": ("dribble_time", lambda geometry: geometry.dribble.time),
        "shoot": ("shot_time", lambda geometry: geometry.shot.time),
    }
)
"""By action: a feature of the same direct variables, and what gives the ideal time in s."""


@dataclass(frozen=True)
class IdealTime:
    """Predicts the ideal time of an action's kind of motion at the robot's limits: nothing is learned."""

    action: str
    robot: Robot

    @property
    def used_variables(self) -> frozenset[str]:
        """Direct variables that the time depends on."""
        return derived_from([IDEAL[self.action][0]])

    def predict(self, direct: Mapping[str, Any], measures: tuple[str, ...] = ()) -> Any:  # noqa: ARG002
        """Give the duration in s, shape (n,), and nothing else."""
        return SimpleNamespace(duration=IDEAL[self.action][1](Geometry(direct, self.robot)))


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
        """Give the duration in s, shape (n,), and nothing else."""
        return SimpleNamespace(duration=self._boosting.predict(feature_table(direct, self.robot, self.names)))
