"""Executions of random situations of one kind of motion, from rest to rest."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from ator_ros.actions import TIME_LIMIT
from ator_ros.actions.base import Action, ActionError, Status, Step
from ator_ros.actions.situation import Situation, drawn_until
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.field import ball_of, objects_of
from ator_ros.domains.soccer.planned.planned_action import PlannedAction
from ator_ros.geometry import Pose
from ator_ros.robot.description import Robot
from ator_ros.simulation.run import judge, place, run_action
from ator_ros.simulation.simulation import Simulation
from ator_ros.tops.outcome import top_of
from ator_ros.world.state import STOP, ObjectState, RobotState, World

KINDS = ("pose", "approach", "dribble", "shoot")
_TURN = math.radians(1.0)
_MOVED = 0.01  # m that an approached ball may have moved before the robot has arrived


@dataclass(frozen=True, slots=True)
class Task:
    """One situation: kind of motion, action set, seed, index, angle (rad) that turns the start, robot."""

    kind: str
    action_set: str
    seed: int
    index: int
    turn: float = 0.0
    robot: str = ""


@dataclass(frozen=True, slots=True)
class Outcome:
    """The result of one execution.

    Attributes
    ----------
    success, early : bool
        Whether the goal was reached; whether the ball was moved before the robot had arrived.
    duration : float
        In s.
    excess : float
        Greatest ratio of a command to its limit.
    poses : tuple of poses
        Start and goal of the axle, for the comparison with time-optimal motion.
    reason : str
        A sentence on how it ended.
    planned : float
        Duration in s planned at the start; NaN if the action has no plan.
    """

    success: bool
    early: bool
    duration: float
    excess: float
    poses: tuple[Pose, Pose]
    reason: str
    planned: float = math.nan


def situation_of(task: Task, robot: Robot) -> Situation:
    """Draw the situation of a task: at rest at start and goal, with the start turned by `task.turn`."""
    rng = np.random.default_rng((task.seed, KINDS.index(task.kind), task.index))
    action = {"pose": "goToPose", "approach": "goToPose", "dribble": "dribbleBall", "shoot": "shoot"}[
        task.kind
    ]
    sample = SOCCER.actions(task.action_set)[action].sample
    drawn = drawn_until(
        lambda: sample(robot, rng),
        lambda one: action != "goToPose" or (ball_of(one) is None) == (task.kind == "pose"),
        lambda: f"{task.kind}: expected a situation of this kind for robot {robot.name}",
    )
    pose = drawn.robot.pose._replace(yaw=drawn.robot.pose.yaw + task.turn)
    ball = ball_of(drawn)
    if ball is not None and task.kind != "approach":
        hold = robot.hold_point(pose)
        ball = ObjectState(hold.x, hold.y)
    return Situation(action, RobotState(pose), objects_of(ball), dataclasses.replace(drawn.goal, speed=0.0))


def execute(task: Task) -> Outcome:
    """Execute one task in a world of its own."""
    return execute_situation(situation_of(task, SOCCER.robot(task.robot or None)), task)


def execute_situation(situation: Situation, task: Task) -> Outcome:
    """Execute `situation` with the action set of `task` in a world of its own."""
    with Simulation(SOCCER.robot(task.robot or None)) as simulation:
        return _execute(simulation, situation, task)


def _execute(simulation: Simulation, situation: Situation, task: Task) -> Outcome:
    robot, goal = simulation.robot, situation.goal
    top = top_of(situation, SOCCER.tops_for(robot), robot)
    place(simulation, World(0.0, situation.robot, situation.objects))
    watch = _Watch(robot)
    poses = (situation.robot.pose, goal.robot_pose(robot))
    try:
        action = SOCCER.actions(task.action_set)[situation.action].factory(robot)
        done = run_action(simulation, action, goal, step=watch.step)
    except ActionError as error:
        return Outcome(False, False, TIME_LIMIT, 0.0, poses, str(error))
    duration = simulation.time
    judgement = judge(simulation, top, goal, done.status, done.message)
    early = task.kind == "approach" and any(
        _touched_early(situation, ball_of(world), world.robot.pose, robot) for world in watch.worlds
    )
    planned = watch.planned if top.arrives else math.nan  # others are planned in part only
    return Outcome(judgement.success, early, duration, watch.excess, poses, judgement.reason, planned)


class _Watch:
    """Records an action while it is executed.

    Attributes
    ----------
    worlds : list of World
        The state of each tick in which it ran.
    planned : float
        Duration in s planned at the start; NaN if the action has no plan.
    excess : float
        Greatest ratio of a command to its limit.
    """

    def __init__(self, robot: Robot) -> None:
        self.worlds: list[World] = []
        self.planned, self.excess = math.nan, 0.0
        self._limits = robot.limits

    def step(self, action: Action, world: World) -> Step:
        """Execute a tick of the action and record it."""
        if not self.worlds and isinstance(action, PlannedAction):
            self.planned = action.left(world)
        step = action.step(world)
        if step.status is Status.RUNNING:
            self.worlds.append(world)
            command = step.command or STOP
            self.excess = max(self.excess, abs(command.v) / self._limits.v, abs(command.w) / self._limits.w)
        return step


def _touched_early(situation: Situation, ball: ObjectState | None, pose: Pose, robot: Robot) -> bool:
    first = ball_of(situation)
    if ball is None or first is None:
        return False
    moved = math.hypot(ball.x - first.x, ball.y - first.y) > _MOVED
    ahead = pose.relative(Pose(ball.x, ball.y, 0.0))
    caught = abs(ahead.y) < 0.05 and ahead.x < robot.hold + 0.03
    return moved and not caught


def tasks(
    kind: str, action_set: str, seed: int, situations: int, turn_degrees: int = 0, *, robot: str = ""
) -> list[Task]:
    """Return the tasks of one kind, with all starts turned by `turn_degrees`."""
    return [Task(kind, action_set, seed, index, turn_degrees * _TURN, robot) for index in range(situations)]
