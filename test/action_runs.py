"""Executions of random situations of one kind of motion, from rest to rest."""

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from ator_ros.actions import TIME_LIMIT
from ator_ros.actions.base import Action, ActionError, Status, Step
from ator_ros.actions.situation import Situation, drawn_until
from ator_ros.bases.description import Robot
from ator_ros.domains.domain import find_domain
from ator_ros.domains.soccer.field import ball_of, objects_of
from ator_ros.geometry import Pose
from ator_ros.simulation.run import judge, place, run_action
from ator_ros.simulation.scene_simulation import Simulation
from ator_ros.tops.library import top_of
from ator_ros.world.state import STOP, ObjectState, RobotState, World

SOCCER = find_domain("soccer")

ACTIONS = {"pose": "goToPose", "approach": "goToPose", "dribble": "dribbleBall", "shoot": "shoot"}
KINDS = tuple(ACTIONS)


@dataclass(frozen=True, slots=True)
class Task:
    """One situation: kind of motion, action set, seed, index, robot."""

    kind: str
    action_set: str
    seed: int
    index: int
    robot: str = ""


@dataclass(frozen=True, slots=True)
class Outcome:
    success: bool
    early: bool  # whether the ball moved before the robot arrived
    duration: float  # s
    excess: float  # greatest ratio of a command to its limit
    reason: str
    backward: float = 0.0  # m/s; greatest commanded speed backward


def situation_of(task: Task, robot: Robot) -> Situation:
    """Draw the situation of a task: at rest at start and goal."""
    rng = np.random.default_rng((task.seed, KINDS.index(task.kind), task.index))
    action = ACTIONS[task.kind]
    sample = SOCCER.actions(task.action_set)[action].sample
    drawn = drawn_until(
        lambda: sample(robot, rng),
        lambda one: action != "goToPose" or (ball_of(one) is None) == (task.kind == "pose"),
        lambda: f"{task.kind}: expected a situation of this kind for robot {robot.name}",
    )
    pose, ball = drawn.robot.pose, ball_of(drawn)
    if ball is not None and task.kind != "approach":
        hold = robot.hold_point(pose)
        ball = ObjectState(hold.x, hold.y)
    return Situation(
        action, RobotState(pose), objects_of(ball), dataclasses.replace(drawn.goal, speed=0.0)
    )


def execute(task: Task) -> Outcome:
    return execute_situation(situation_of(task, SOCCER.robot(task.robot or None)), task)


def execute_situation(situation: Situation, task: Task) -> Outcome:
    robot, goal = SOCCER.robot(task.robot or None), situation.goal
    limits, worlds, excess, backward = robot.limits, list[World](), [0.0], [0.0]

    def watched(action: Action, world: World) -> Step:
        step = action.step(world)
        if step.status is Status.RUNNING:
            command = step.command or STOP
            worlds.append(world)
            backward.append(-command.vx)
            excess.append(max(abs(command.vx) / limits.v, abs(command.w) / limits.w))
        return step

    with Simulation(robot) as simulation:
        top = top_of(situation, SOCCER.tops_for(robot), robot)
        place(simulation, World(0.0, situation.robot, situation.objects))
        try:
            action = SOCCER.actions(task.action_set)[situation.action].factory(robot)
            done = run_action(simulation, action, goal, step=watched)
        except ActionError as error:
            return Outcome(False, False, TIME_LIMIT, 0.0, str(error))
        duration = simulation.time
        judgment = judge(simulation, top, goal, done.status, done.message)
    early = task.kind == "approach" and any(
        _touched_early(situation, world, robot) for world in worlds
    )
    return Outcome(judgment.success, early, duration, max(excess), judgment.reason, max(backward))


def _touched_early(situation: Situation, world: World, robot: Robot) -> bool:
    first, ball = ball_of(situation), ball_of(world)
    if ball is None or first is None:
        return False
    ahead = world.robot.pose.relative(Pose(ball.x, ball.y, 0.0))
    caught = abs(ahead.y) < 0.05 and ahead.x < robot.hold + 0.03
    return math.hypot(ball.x - first.x, ball.y - first.y) > 0.01 and not caught
