"""The situations that the actions of a chain meet when the subgoals are reached (paper, section 4.1).

Everything is in columns: a name to a float, or to an array of shape (n,) where candidates differ. The names
are those of the experience table's direct variables.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ator_ros.actions.base import Goal, Point
from ator_ros.actions.goal_variables import direct_name, goal_values
from ator_ros.geometry import FloatArray
from ator_ros.performance.direct import SPEEDG, XG, YAW, YAWG, YG, DirectTable, V, X, Y, names_with
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import TopChain
from ator_ros.world.state import World

Columns = dict[str, float | FloatArray]

_START = ("x", "y", "yaw", "v", "w")
_NAMES = names_with(())
_START_ROWS = {"x": X, "y": Y, "yaw": YAW, "speed": V}
_GOAL_ROWS = {"x": XG, "y": YG, "yaw": YAWG, "speed": SPEEDG}
"""Rows of the goal variables in the table of the step after their goal, and of that which leads to it."""


def start_columns(world: World) -> Columns:
    """Return the start variables x, y, yaw (m, rad), v, w (m/s, rad/s) of the state `world`."""
    robot = world.robot
    return {
        "x": robot.pose.x, "y": robot.pose.y, "yaw": robot.pose.yaw, "v": robot.v, "w": robot.w
    }  # fmt: skip


def goal_columns(goal: Goal, names: Sequence[str], values: FloatArray) -> Columns:
    """Return the goal variables of `goal`, those in `names` replaced by candidates.

    Parameters
    ----------
    goal : Goal
        The subgoal.
    names : sequence of str, length k
        Its free variables.
    values : ndarray, shape (n, k)
        Candidates. A single one stays a float.
    """
    columns: Columns = dict(goal_values(goal))
    for column, name in enumerate(names):
        columns[name] = values[:, column] if len(values) > 1 else float(values[0, column])
    return columns


def columns_after(goal: Mapping[str, Any], point: Point, robot: Robot) -> Columns:
    """Return the start variables of the action that follows a subgoal reached exactly, not turning."""
    x, y, yaw = goal["x"], goal["y"], goal["yaw"]
    if point is Point.HOLD:
        x, y = x - robot.hold * np.cos(yaw), y - robot.hold * np.sin(yaw)
    return {"x": x, "y": y, "yaw": yaw, "v": goal["speed"], "w": 0.0}


def direct_columns(start: Mapping[str, Any], goal: Mapping[str, Any], point: Point) -> Columns:
    """Return the direct variables of one action from its start and goal variables."""
    columns: Columns = dict(start)
    columns.update((direct_name(name), value) for name, value in goal.items())
    columns["hold"] = 1.0 if point is Point.HOLD else 0.0
    return columns


class StepRows:
    """The direct variables of one step of a chain, for candidates of the subgoals on both its sides.

    Parameters
    ----------
    start : sequence of float
        Start variables x, y, yaw, v, w, as the chain has them.
    goal : Goal
        The subgoal that the step leads to.
    names : sequence of str
        Its free variables.
    previous : Goal, optional
        The subgoal at which the step starts; None for the first step.
    previous_names : sequence of str
        Its free variables.
    hold : float
        Distance in m from the axle to what the robot holds.
    """

    def __init__(
        self,
        start: Sequence[float],
        goal: Goal,
        names: Sequence[str],
        previous: Goal | None,
        previous_names: Sequence[str],
        hold: float,
    ) -> None:
        pose, declared = goal.pose, sorted(goal.values)
        self._names = names_with(map(direct_name, declared)) if declared else _NAMES
        self._alike = np.array(
            [
                *start,
                *(pose.x, pose.y, pose.yaw, goal.speed, 1.0 if goal.point is Point.HOLD else 0.0),
                *(goal.values[name] for name in declared),
            ],
            dtype=float,
        )
        self._of_goal = [
            (_GOAL_ROWS[name] if name in _GOAL_ROWS else self._names.index(direct_name(name)), column)
            for column, name in enumerate(names)
        ]
        self._of_start = [
            (_START_ROWS[name], column) for column, name in enumerate(previous_names) if name in _START_ROWS
        ]
        self._held = previous.pose if previous is not None and previous.point is Point.HOLD else None
        self._hold = hold

    def table(self, before: FloatArray, after: FloatArray) -> DirectTable:
        """Return the table for candidates, shapes (n or 1, k), of the subgoals before and after the step."""
        table = self._alike[:, None].repeat(max(len(before), len(after)), axis=1)
        for row, column in self._of_goal:
            table[row] = after[:, column]
        for row, column in self._of_start:
            table[row] = before[:, column]
        if self._held is not None and self._of_start:
            yaw, moved = table[YAW], {row for row, _ in self._of_start}
            for row, given, way in ((X, self._held.x, np.cos(yaw)), (Y, self._held.y, np.sin(yaw))):
                table[row] = (table[row] if row in moved else given) - self._hold * way
        return DirectTable(self._names, table)


def chain_situations(world: World, chain: TopChain, robot: Robot) -> list[Columns]:
    """Return the direct variables of each action of `chain`, all of whose subgoals are reached exactly."""
    start, situations = start_columns(world), []
    for call in chain.calls:
        goal: Columns = dict(goal_values(call.goal))
        situations.append(direct_columns(start, goal, call.goal.point))
        start = columns_after(goal, call.goal.point, robot)
    return situations


def step_rows(world: World, chain: TopChain, robot: Robot, names: Sequence[Sequence[str]]) -> list[StepRows]:
    """Return the direct variables of each action of `chain`; `names` are the subgoals' free variables."""
    state, rows = world.robot, []
    start: Sequence[float] = (*state.pose, state.v, state.w)
    previous: Goal | None = None
    for index, call in enumerate(chain.calls):
        before = names[index - 1] if index else ()
        rows.append(StepRows(start, call.goal, names[index], previous, before, robot.hold))
        previous = call.goal
        start = _start_at(previous, robot)
    return rows


def _start_at(goal: Goal, robot: Robot) -> tuple[float, float, float, float, float]:
    """Return the start variables of the action that follows a goal reached exactly, not turning."""
    x, y, yaw = goal.pose
    if goal.point is Point.HOLD:
        x, y = x - robot.hold * np.cos(yaw), y - robot.hold * np.sin(yaw)
    return x, y, yaw, goal.speed, 0.0
