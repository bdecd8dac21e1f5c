"""The situations that the actions of a chain meet when the subgoals are reached (paper, section 4.1).

`StepRows` makes the table of a step's direct variables for many candidates. Elsewhere variables are in
columns: a name to a float, or to an array of shape (n,) where candidates differ.
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
from ator_ros.tops.chain import TopChain, projected
from ator_ros.world.state import World

Columns = dict[str, float | FloatArray]

_NAMES = names_with(())
_START_ROWS = {"x": X, "y": Y, "yaw": YAW, "speed": V}
_GOAL_ROWS = {"x": XG, "y": YG, "yaw": YAWG, "speed": SPEEDG}
"""Rows of the goal variables in the table of the step after their goal, and of that which leads to it."""


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
    """Return the start variables x, y, yaw, v, w of the action that follows a subgoal reached exactly."""
    x, y, yaw = goal["x"], goal["y"], goal["yaw"]
    if point is Point.HOLD:
        x, y = x - robot.hold * np.cos(yaw), y - robot.hold * np.sin(yaw)
    return {"x": x, "y": y, "yaw": yaw, "v": goal["speed"], "w": 0.0}


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
        start: Sequence[Any],
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
        count = max(len(before) if self._of_start else 1, len(after) if self._of_goal else 1)
        table = self._alike[:, None].repeat(count, axis=1)
        for row, column in self._of_goal:
            table[row] = after[:, column]
        for row, column in self._of_start:
            table[row] = before[:, column]
        if self._held is not None and self._of_start:
            yaw, moved = table[YAW], {row for row, _ in self._of_start}
            for row, given, way in ((X, self._held.x, np.cos(yaw)), (Y, self._held.y, np.sin(yaw))):
                table[row] = (table[row] if row in moved else given) - self._hold * way
        return DirectTable(self._names, table)


def step_rows(world: World, chain: TopChain, robot: Robot, names: Sequence[Sequence[str]]) -> list[StepRows]:
    """Return the direct variables of each action of `chain`; `names` are the subgoals' free variables.

    A step whose TOP does not arrive leaves the robot where its post-condition, as the chain has it, puts it.
    """
    state, rows = world.robot, []
    start: Sequence[Any] = (*state.pose, state.v, state.w)
    previous: Goal | None = None
    before: Sequence[str] = ()
    stays = any(not call.top.arrives for call in chain.calls[:-1])
    for index, call in enumerate(chain.calls):
        rows.append(StepRows(start, call.goal, names[index], previous, before, robot.hold))
        if stays:
            world = projected(world, call, robot)
        if call.top.arrives:
            previous, before = call.goal, names[index]
            start = tuple(columns_after(goal_values(previous), previous.point, robot).values())
        else:
            previous, before = None, ()
            start = (*world.robot.pose, world.robot.v, world.robot.w)
    return rows


def chain_situations(world: World, chain: TopChain, robot: Robot) -> list[DirectTable]:
    """Return the direct variables of each action of `chain`, all of whose subgoals are reached exactly."""
    as_given = np.zeros((1, 0))
    rows = step_rows(world, chain, robot, [()] * len(chain.calls))
    return [step.table(as_given, as_given) for step in rows]
