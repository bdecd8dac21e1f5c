"""The situations that the actions of a chain meet when the subgoals are reached (paper, section 4.1).

Everything is in columns: a name to a float, or to an array of shape (n,) where candidates differ. The names
are those of the experience table's direct variables.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ator_ros.actions.base import Goal, Point
from ator_ros.actions.goal_variables import GOAL_VARIABLES, direct_name, goal_values
from ator_ros.geometry import FloatArray
from ator_ros.performance.direct import DirectTable, names_with
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import TopChain
from ator_ros.world.state import World

Columns = dict[str, float | FloatArray]

_START = ("x", "y", "yaw", "v", "w")


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


def direct_rows(start: Mapping[str, Any], goal: Mapping[str, Any], point: Point) -> DirectTable:
    """Return the same as a table: a row of each, as long as there are candidates."""
    declared = sorted(goal.keys() - GOAL_VARIABLES) if len(goal) > len(GOAL_VARIABLES) else []
    columns = [start[name] for name in _START]
    columns += [goal[name] for name in GOAL_VARIABLES]
    columns.append(1.0 if point is Point.HOLD else 0.0)
    columns += [goal[name] for name in declared]
    differing = [row for row, column in enumerate(columns) if isinstance(column, np.ndarray)]
    alike = np.array([0.0 if row in differing else column for row, column in enumerate(columns)])
    table = alike[:, None].repeat(len(columns[differing[0]]) if differing else 1, axis=1)
    for row in differing:
        table[row] = columns[row]
    return DirectTable(names_with(map(direct_name, declared)), table)


def chain_situations(world: World, chain: TopChain, robot: Robot) -> list[Columns]:
    """Return the direct variables of each action of `chain`, all of whose subgoals are reached exactly."""
    start, situations = start_columns(world), []
    for call in chain.calls:
        goal: Columns = dict(goal_values(call.goal))
        situations.append(direct_columns(start, goal, call.goal.point))
        start = columns_after(goal, call.goal.point, robot)
    return situations
