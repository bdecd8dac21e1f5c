"""References for the learned models: ideal times without learning, and gradient boosting."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
from sklearn.ensemble import HistGradientBoostingRegressor

from ator_ros.domains.domain import Domain
from ator_ros.geometry import FloatArray
from ator_ros.performance.derived import Geometry, hold_angle, hold_dist
from ator_ros.performance.features import GENERAL, Feature, derived_from, feature_table, variables
from ator_ros.performance.training import direct_of
from ator_ros.robot.description import Robot
from ator_ros.tops.objects import kept

START_WEIGHT = 20.0
"""Weight of the start of an episode; its other rows weigh 1."""


@dataclass(frozen=True)
class IdealTime:
    """Predicts an ideal time at the robot's limits, without learning.

    Attributes
    ----------
    robot : Robot
        Its limits, and the position of its hold.
    used_variables : frozenset of str
        The direct variables that the time depends on.
    compute : callable
        Returns the time in s, shape (n,).
    """

    robot: Robot
    used_variables: frozenset[str]
    compute: Callable[[Geometry], FloatArray]

    def predict(self, direct: Mapping[str, Any], measures: tuple[str, ...] = ()) -> Any:  # noqa: ARG002
        """Return the duration in s, shape (n,), and nothing else."""
        return SimpleNamespace(duration=self.compute(Geometry(direct, self.robot)))


def ideal_times(domain: Domain, robot: Robot, action_set: str) -> dict[str, IdealTime]:
    """Return by action the ideal time among its candidate features, for the actions that have one."""
    return {
        action: IdealTime(robot, feature.derives, feature.compute)
        for action in domain.actions(action_set)
        for feature in domain.candidates(action, action_set)
        if feature.ideal
    }


def plain_times(domain: Domain, robot: Robot, action_set: str) -> dict[str, IdealTime]:
    """Return by action the time to turn, drive straight and turn again at the robot's limits.

    The drive may go backward unless the robot holds an object all the way. An action that does not move the
    robot to its goal turns the hold toward it and drives there.
    """

    def either_way(geometry: Geometry) -> FloatArray:
        return np.minimum(geometry.turn_drive_turn(), geometry.turn_drive_turn(reverse=True))

    turning, arriving = GENERAL["turn_drive_turn"], {top.action for top in domain.tops if top.arrives}
    holding = {top.action for top in domain.tops if kept(top) is not None}
    times = {}
    for action in domain.actions(action_set):
        if action not in arriving:
            times[action] = IdealTime(robot, variables("x y yaw xg yg"), _turn_and_drive)
        else:
            compute = turning.compute if action in holding else either_way
            times[action] = IdealTime(robot, turning.derives, compute)
    return times


def _turn_and_drive(geometry: Geometry) -> FloatArray:
    limits = geometry.robot.limits
    return np.abs(geometry.once(hold_angle)) / limits.w + geometry.once(hold_dist) / limits.v


class BoostedTime:
    """Predicts durations with histogram gradient boosting over all described features; not a readable model.

    Parameters
    ----------
    robot : Robot
        Its limits, and the position of its hold.
    features : tuple of Feature
        What it predicts from.
    """

    def __init__(self, robot: Robot, features: tuple[Feature, ...]) -> None:
        self.robot = robot
        self.features = features
        self.used_variables = derived_from(features)
        self._boosting = HistGradientBoostingRegressor(max_iter=250, learning_rate=0.08, random_state=0)

    def fit(self, rows: pd.DataFrame) -> BoostedTime:
        """Fit to the rows of one action of a table of experience; starts have the weight START_WEIGHT."""
        # Samples at 1 Hz: more of the same episodes take time and add little.
        sampled = np.isclose(rows["t"] % 1.0, 0.0, atol=0.01)
        good = rows[rows["success"] & sampled]
        table = feature_table(direct_of(good), self.robot, self.features)
        weight = np.where(good["t"] == 0.0, START_WEIGHT, 1.0)
        self._boosting.fit(table, good["time_to_go"].to_numpy(dtype=float), sample_weight=weight)
        return self

    def predict(self, direct: Mapping[str, Any], measures: tuple[str, ...] = ()) -> Any:  # noqa: ARG002
        """Return the duration in s, shape (n,), and nothing else."""
        table = feature_table(direct, self.robot, self.features)
        return SimpleNamespace(duration=self._boosting.predict(table))
