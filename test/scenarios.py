"""Runs of actions in the simulator, and predicates over them: eventually, always."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ator_ros.actions.base import Action, Status, Step
from ator_ros.actions.situation import Situation
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.field import ball_of, field_of
from ator_ros.geometry import wrap_angle
from ator_ros.robot.description import Robot
from ator_ros.simulation.run import place, run_action, settle
from ator_ros.simulation.simulation import Simulation
from ator_ros.tops.outcome import top_of
from ator_ros.world.state import World

_RATE = 20


@dataclass(frozen=True)
class Run:
    """What happened: states and steps in the ticks of an action, and the state after a shot rolled out."""

    robot: Robot
    situation: Situation
    worlds: list[World]
    steps: list[Step]
    end: World


def run(simulation: Simulation, action: Action, situation: Situation, *, time_limit: float = 30.0) -> Run:
    """Execute `action` in `situation` until it ends or `time_limit` (s) is over."""
    place(simulation, World(0.0, situation.robot, situation.objects))
    worlds, steps = [], []

    def observed(action: Action, world: World) -> Step:
        worlds.append(world)
        steps.append(action.step(world))
        return steps[-1]

    run_action(simulation, action, situation.goal, time_limit=time_limit, step=observed)
    end = settle(simulation, top_of(situation, SOCCER.tops, simulation.robot), situation.goal)
    return Run(simulation.robot, situation, worlds, steps, end)


def run_many(robot: Robot, action: Action, *, seed: int, count: int) -> list[Run]:
    """Execute `action` in `count` random situations, all drawn from `seed`, in one world."""
    rng = np.random.default_rng(seed)
    with Simulation(robot) as simulation:
        runs: list[Run] = []
        while len(runs) < count:
            situation = SOCCER.actions()[action.name].sample(robot, rng)
            if not _in_a_post(robot, situation):
                runs.append(run(simulation, action, situation))
        return runs


def _in_a_post(robot: Robot, situation: Situation) -> bool:
    """Return whether robot or ball would start inside a goal's post, where physics throws them out."""
    pose, field = situation.robot.pose, field_of(robot)
    points = [
        (pose.x, pose.y),
        *([(ball_of(situation).x, ball_of(situation).y)] if ball_of(situation) else []),
    ]
    return any(
        math.hypot(max(field.length / 2 - abs(x), 0.0), abs(y) - field.goal_width / 2) < robot.reach
        for x, y in points
    )


def eventually_at_the_pose(run: Run, *, position: float = 0.05, heading: float = 0.1) -> bool:
    """Return whether the action succeeded within `position` (m) and `heading` (rad) of its goal."""
    target, pose = run.situation.goal.robot_pose(run.robot), run.worlds[-1].robot.pose
    there = pose.distance(target) < position and abs(wrap_angle(pose.yaw - target.yaw)) < heading
    return run.steps[-1].status is Status.SUCCEEDED and there


def always_within_limits(run: Run, *, slack: float = 0.03) -> bool:
    """Return whether all commands kept the base's limits, and all velocities but for `slack` (m/s, rad/s)."""
    limits = run.robot.limits
    commands = all(abs(step.command.v) <= limits.v and abs(step.command.w) <= limits.w for step in run.steps)
    states = (world.robot for world in run.worlds)
    return commands and all(
        abs(state.v) <= limits.v + slack and abs(state.w) <= limits.w + slack for state in states
    )


def ball_stays_until_the_end(run: Run, *, moved: float = 0.02, last: float = 0.3) -> bool:
    """Return whether the ball moved less than `moved` (m) until `last` (s) before the end."""
    first = ball_of(run.worlds[0])
    assert first is not None
    before = run.worlds[: max(1, len(run.worlds) - round(last * _RATE))]
    balls = [ball_of(world) for world in before if ball_of(world) is not None]
    return len(balls) == len(before) and all(
        math.hypot(ball.x - first.x, ball.y - first.y) < moved for ball in balls
    )


def always_holds_the_ball(run: Run, *, distance: float = 0.1) -> bool:
    """Return whether the ball was never farther than `distance` (m) from the hold."""
    for world in run.worlds:
        hold = run.robot.hold_point(world.robot.pose)
        if (
            ball_of(world) is None
            or math.hypot(ball_of(world).x - hold.x, ball_of(world).y - hold.y) > distance
        ):
            return False
    return True


def ball_in_the_goal(run: Run) -> bool:
    """Return whether the ball ended behind the goal line, between the posts."""
    ball, field = ball_of(run.end), field_of(run.robot)
    return ball is not None and abs(ball.x) > field.length / 2 and abs(ball.y) < field.goal_width / 2
