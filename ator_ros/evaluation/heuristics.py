"""Linear models of duration in distance and turns, as RoboCup teams use them without learning.

Each model replaces the learned ones in the same search, with the coefficients that its team chose by hand
and with coefficients refitted to our robot's experience.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType, SimpleNamespace
from typing import Any, Protocol

import numpy as np
import pandas as pd
from scipy.optimize import nnls

from ator_ros.evaluation.errors import EvaluationError
from ator_ros.files import FileError, read_json, write_text
from ator_ros.formats import Format
from ator_ros.geometry import FloatArray, wrap_angles
from ator_ros.performance.direct import DIRECT_VARIABLES
from ator_ros.robot.description import Robot
from ator_ros.schema import SchemaError, structured
from ator_ros.tops.top import Top

_USED = frozenset({"x", "y", "yaw", "xg", "yg", "yawg", "hold"})
FORMAT = Format("ator_ros baselines", 1, "file of baselines")


@dataclass(frozen=True, slots=True)
class LinearTime:
    """A time that is linear in the distance, the turn toward the goal, and the turn at the goal.

    Attributes
    ----------
    per_metre : float
        In s/m.
    per_start_turn, per_goal_turn : float
        In s/rad.
    hold : float
        Distance in m between the axle and a held object.
    constant : float
        In s.
    """

    per_metre: float
    per_start_turn: float
    per_goal_turn: float
    hold: float
    constant: float = 0.0

    @property
    def used_variables(self) -> frozenset[str]:
        """Direct variables that the time depends on."""
        return _USED if self.per_goal_turn else _USED - {"yawg"}

    def predict(self, direct: Mapping[str, Any], measures: tuple[str, ...] = ()) -> Any:  # noqa: ARG002
        """Return the duration in s, shape (n,), and nothing else."""
        distance, start_turn, goal_turn = linear_terms(direct, self.hold, aims=self.per_goal_turn > 0.0)
        duration = self.constant + self.per_metre * distance
        duration = duration + self.per_start_turn * start_turn + self.per_goal_turn * goal_turn
        return SimpleNamespace(duration=np.atleast_1d(duration))


def linear_terms(
    direct: Mapping[str, Any], hold: float, *, aims: bool = True
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return distance (m) and the turns (rad) at the start and at the goal between two poses of the axle.

    Parameters
    ----------
    direct : mapping
        Direct variables.
    hold : float
        Distance in m between the axle and a held object.
    aims : bool
        Whether the goal has a heading; otherwise its position is that of the axle.
    """
    offset = np.asarray(direct["hold"]) * hold * aims
    dx = direct["xg"] - offset * np.cos(direct["yawg"]) - direct["x"]
    dy = direct["yg"] - offset * np.sin(direct["yawg"]) - direct["y"]
    bearing = np.arctan2(dy, dx)
    start_turn = np.abs(wrap_angles(bearing - direct["yaw"]))
    goal_turn = np.abs(wrap_angles(direct["yawg"] - bearing)) * aims
    return np.hypot(dx, dy), start_turn, goal_turn


def arriving(tops: Iterable[Top]) -> frozenset[str]:
    """Return the actions whose TOPs place the robot at the goal, so that it turns to the goal's heading."""
    return frozenset(top.action for top in tops if top.arrives)


def bitbots(robot: Robot, *, arrives: bool) -> LinearTime:
    """Return the time model of bit-bots: 7.0 s/m, 3.82 s/rad of either turn."""
    return LinearTime(7.0, 3.82, 3.82 if arrives else 0.0, robot.hold)


def booster(robot: Robot, *, arrives: bool) -> LinearTime:
    """Return the cost of Booster's RoboCup demo: range at 1 m/s, turn at 1 rad/s, 1.33 s/rad of angle."""
    return LinearTime(1.0, 1.0, 1.33 if arrives else 0.0, robot.hold)


def refit(model: LinearTime, starts: pd.DataFrame) -> LinearTime:
    """Fit the coefficients of `model` to observed durations; equal weights of both turns stay equal.

    Parameters
    ----------
    model : LinearTime
        Determines which terms have a weight, and which weights are equal.
    starts : pandas.DataFrame
        One row per successful episode: direct variables at the start, and the duration in s.
    """
    direct = {name: starts[name].to_numpy(dtype=float) for name in DIRECT_VARIABLES}
    distance, start_turn, goal_turn = linear_terms(direct, model.hold, aims=model.per_goal_turn > 0.0)
    ones = np.ones(len(starts))
    duration = starts["duration"].to_numpy(dtype=float)
    if model.per_start_turn == model.per_goal_turn:
        (constant, per_metre, turn), _ = nnls(np.stack([ones, distance, start_turn + goal_turn], 1), duration)
        coefficients = (float(per_metre), float(turn), float(turn))
    else:
        (constant, *rest), _ = nnls(np.stack([ones, distance, start_turn, goal_turn], 1), duration)
        coefficients = (float(rest[0]), float(rest[1]), float(rest[2]))
    return LinearTime(*coefficients, hold=model.hold, constant=float(constant))


class HandSet(Protocol):
    """Makes the model that a team chose by hand for an action."""

    def __call__(self, robot: Robot, *, arrives: bool) -> LinearTime:
        """Return the model of an action that brings the robot to its goal, or of one that does not."""


HAND_SET: Mapping[str, HandSet] = MappingProxyType({"bitbots": bitbots, "booster": booster})


@dataclass(frozen=True)
class _Coefficients:
    """Those of a `LinearTime`; the hold is the robot's."""

    per_metre: float
    per_start_turn: float
    per_goal_turn: float
    constant: float


@dataclass(frozen=True)
class _BaselinesFile:
    """Coefficients by the name of the set, by action."""

    models: dict[str, dict[str, _Coefficients]]


def save_baselines(path: Path, starts: Mapping[str, pd.DataFrame], robot: Robot, tops: Iterable[Top]) -> None:
    """Refit both teams' models to the successful starts of each action, and write the coefficients."""
    headed = arriving(tops)
    models = {
        f"{team}_refitted": {
            action: dataclasses.asdict(refit(make(robot, arrives=action in headed), rows))
            for action, rows in starts.items()
        }
        for team, make in HAND_SET.items()
    }
    write_text(path, FORMAT.text({"models": models}))


def load_baselines(path: Path, robot: Robot) -> dict[str, dict[str, LinearTime]]:
    """Read refitted models: by name of the set, by action.

    Raises
    ------
    EvaluationError
        The file cannot be read or lacks a coefficient; the message says what was expected.
    """
    try:
        file = structured(FORMAT.current(read_json(path)), _BaselinesFile)
    except FileError as error:
        raise EvaluationError(str(error)) from error
    except SchemaError as error:
        raise EvaluationError(f"{path}: {error}") from error
    names = [f"{team}_refitted" for team in HAND_SET]
    if missing := [name for name in names if name not in file.models]:
        raise EvaluationError(f"{path}: models: expected {', '.join(names)}; missing {', '.join(missing)}")
    return {
        name: {action: _linear_time(row, robot) for action, row in file.models[name].items()}
        for name in names
    }


def _linear_time(row: _Coefficients, robot: Robot) -> LinearTime:
    return LinearTime(
        row.per_metre, row.per_start_turn, row.per_goal_turn, hold=robot.hold, constant=row.constant
    )
