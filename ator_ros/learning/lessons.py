"""Training rows for one measure of an action's performance: the starts of its episodes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from ator_ros.experience.store_reading import NUMBER
from ator_ros.geometry import FloatArray
from ator_ros.performance.driving import DrivingStyle
from ator_ros.performance.features import Feature, feature_table, names_of
from ator_ros.performance.training import OUTCOMES, direct_of
from ator_ros.performance.tree.nodes import IntArray, ModelTree
from ator_ros.robot.description import Robot

_COLUMNS = {"duration": "duration", **OUTCOMES}


class Records:
    """Starts of an action's episodes with their features, computed once.

    Parameters
    ----------
    rows : pandas.DataFrame
        The starts, oldest first, with `NUMBER`.
    robot : Robot
        For whose limits features are computed.
    features : mapping
        Features by name: the candidates, and those of models that are known.
    driving : DrivingStyle or None
        How the action drives, as far as features need it.
    """

    def __init__(
        self, rows: pd.DataFrame, robot: Robot, features: Mapping[str, Feature], driving: DrivingStyle | None
    ) -> None:
        self.rows = rows
        wanted = tuple(features.values())
        with np.errstate(all="ignore"):
            table = feature_table(direct_of(rows), robot, wanted, driving)
        self.table = pd.DataFrame(table, columns=list(names_of(wanted)))

    def lessons(self, measure: str) -> Lessons:
        """Return what they tell of a measure; of the duration and the errors only those that succeeded do."""
        values = self.rows[_COLUMNS[measure]].to_numpy(dtype=float)
        tell = np.isfinite(values)
        if measure != "success":
            tell &= self.rows["success"].to_numpy(dtype=bool)
        numbers = self.rows[NUMBER].to_numpy()
        return Lessons(measure, self.table[tell].reset_index(drop=True), values[tell], numbers[tell])


class Lessons:
    """Records of one measure, oldest first.

    Attributes
    ----------
    measure : str
        One of `MEASURES`.
    table : pandas.DataFrame
        Their features.
    values : ndarray, shape (n,)
        The measure.
    numbers : ndarray of int, shape (n,)
        See `NUMBER`.
    """

    def __init__(self, measure: str, table: pd.DataFrame, values: FloatArray, numbers: IntArray) -> None:
        self.measure, self.table, self.values, self.numbers = measure, table, values, numbers

    def predicted(self, tree: ModelTree, which: IntArray | slice = slice(None)) -> FloatArray:
        """Return what a tree predicts of some of the records."""
        values = tree.predict(np.ascontiguousarray(self.table[list(tree.names)].to_numpy()[which]))
        return np.clip(values, 0.0, 1.0) if self.measure == "success" else np.maximum(values, 0.0)

    def losses(self, predicted: FloatArray, which: IntArray) -> FloatArray:
        """Return the losses of predictions: absolute errors, of success squared ones (Brier score)."""
        errors = np.abs(self.values[which] - predicted)
        return errors * errors if self.measure == "success" else errors
