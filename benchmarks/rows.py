"""The rows that all learners of a comparison get."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ator_ros.experience.table import read_experience
from ator_ros.geometry import FloatArray
from ator_ros.performance.features import feature_table
from ator_ros.performance.training import direct_of
from ator_ros.robot import Robot


@dataclass(frozen=True, eq=False)
class Rows:
    """Examples of an action's duration.

    Attributes
    ----------
    X : array of float, shape (n, n_features)
    y : array of float, shape (n,)
        Time to go in s.
    groups : array of int, shape (n,)
        Episode of each row.
    names : tuple of str
        Features, in the order of the columns.
    """

    X: FloatArray
    y: FloatArray
    groups: NDArray[np.intp]
    names: tuple[str, ...]

    def pick(self, which: NDArray[np.bool_]) -> Rows:
        """Give the rows where `which`, shape (n,), is true."""
        return Rows(self.X[which], self.y[which], self.groups[which], self.names)


def load_rows(path: Path, action: str, robot: Robot, names: Sequence[str]) -> Rows:
    """Read from the table of `collect` the episodes of `action` that succeeded, with the features `names`."""
    frame = read_experience(path).of(action)
    frame = frame[frame["success"]]
    X = feature_table(direct_of(frame), robot, names)
    y = frame["time_to_go"].to_numpy(dtype=np.float64)
    return Rows(np.ascontiguousarray(X), y, frame["episode"].to_numpy(dtype=np.intp), tuple(names))


def split(rows: Rows, *, test_share: float, seed: int) -> tuple[Rows, Rows]:
    """Hold out a share of the episodes, whole: rows of one episode resemble each other."""
    episodes = np.unique(rows.groups)
    held_out = np.random.default_rng(seed).permutation(episodes)[: round(test_share * len(episodes))]
    is_test = np.isin(rows.groups, held_out)
    return rows.pick(~is_test), rows.pick(is_test)
