"""Duration of soccer's actions against the start's heading, in slices: regular actions give smooth curves."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ator_ros.actions.base import Goal, Point
from ator_ros.actions.situation import Situation
from ator_ros.domains.soccer.ball import BALL
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.quality.action_quality import Outcome, Task, execute_situation
from ator_ros.experience.parallel import run_tasks
from ator_ros.files import replaced
from ator_ros.geometry import Pose
from ator_ros.world.state import ObjectState, RobotState

STEP_DEGREES = 4
GOALS = (Pose(1.0, 0.0, 0.0), Pose(2.0, 1.0, 1.5), Pose(1.5, -1.0, 3.0))


@dataclass(frozen=True, slots=True)
class SliceTask:
    """One point of a slice: kind of motion, number of the goal, heading of the start in degrees, robot."""

    kind: str
    action_set: str
    goal: int
    degrees: int
    robot: str = ""


def execute_point(point: SliceTask) -> Outcome:
    """Execute one point of a slice; robot or held ball start at (-1, 0)."""
    robot = SOCCER.robot(point.robot or None)
    start = Pose(-1.0, 0.0, math.radians(point.degrees))
    goal = GOALS[point.goal]
    if point.kind == "dribble":
        pose = robot.pose_holding(start)
        situation = Situation(
            "dribbleBall",
            RobotState(pose),
            {BALL: ObjectState(start.x, start.y)},
            Goal(goal, 0.0, Point.HOLD),
        )
    elif point.kind == "approach":
        situation = Situation(
            "goToPose", RobotState(start), {BALL: ObjectState(goal.x, goal.y)}, Goal(goal, 0.0, Point.HOLD)
        )
    else:
        situation = Situation("goToPose", RobotState(start), {}, Goal(goal))
    return execute_situation(situation, Task(point.kind, point.action_set, 0, 0, robot=point.robot))


def points(kind: str, action_set: str, robot: str = "") -> Iterator[SliceTask]:
    """Yield all points of the slices of one kind."""
    for goal in range(len(GOALS)):
        for degrees in range(-180, 181, STEP_DEGREES):
            yield SliceTask(kind, action_set, goal, degrees, robot)


def draw_slices(path: Path, action_set: str, jobs: int, robot: str = "") -> None:
    """Execute the slices of all kinds and draw them to `path`."""
    from matplotlib.figure import Figure

    kinds = ("pose", "approach", "dribble")
    figure = Figure(figsize=(11, 3.6), layout="constrained")
    for axes, kind in zip(figure.subplots(1, len(kinds), sharey=True), kinds, strict=True):
        tasks = list(points(kind, action_set, robot))
        outcomes = list(run_tasks(execute_point, tasks, jobs=jobs))
        for number, goal in enumerate(GOALS):
            of_goal = [(t.degrees, o) for t, o in zip(tasks, outcomes, strict=True) if t.goal == number]
            durations = [o.duration if o.success else np.nan for _, o in of_goal]
            label = f"to ({goal.x:g}, {goal.y:g}) m, {goal.yaw:g} rad"
            axes.plot([degrees for degrees, _ in of_goal], durations, ".-", markersize=3, label=label)
        axes.set_title(kind)
        axes.set_xlabel("heading at the start (degrees)")
        axes.set_xticks(range(-180, 181, 90))
        axes.grid(alpha=0.3)
    figure.axes[0].set_ylabel("duration (s)")
    figure.axes[0].set_ylim(bottom=0.0)
    figure.axes[0].legend(fontsize="small")
    with replaced(path) as temporary:
        figure.savefig(temporary, dpi=110)
