"""Measure the longest ticks of the actions where a way is hard to find or there is none."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress

import numpy as np

from ator_ros.actions.base import Action, ActionError, Goal, Point, Status, started
from ator_ros.domains.measurements import LongestTick, PlannedPoints, Ticks
from ator_ros.domains.soccer.ball import BALL, ball_of, objects_of
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.field import field_of
from ator_ros.domains.soccer.planned.planned_action import PlannedAction
from ator_ros.geometry import Pose
from ator_ros.motion.planning import SLICE, Search
from ator_ros.motion.trajectory import opening_of
from ator_ros.robot.description import Robot
from ator_ros.robot.response import ramped
from ator_ros.tops.objects import is_lost
from ator_ros.world.state import CONTROL_PERIOD, STOP, Command, ObjectState, RobotState, World

LIMIT_MS = 40.0
_TICKS = 40


def measure(robot: Robot, situations: int = 120) -> Ticks:
    """Measure the longest tick of each action set: processor time in ms over the first two seconds."""
    results: dict[str, LongestTick | PlannedPoints] = {}
    for name in SOCCER.action_sets:
        actions = SOCCER.actions(name)
        longest = []
        for action, world, goal in hard_situations(robot, 60, seed=16):  # as nodes do before they are ready
            tick_times(actions[action].factory(robot), world, goal)
        for action, world, goal in hard_situations(robot, situations, seed=17):
            longest.append(max(tick_times(actions[action].factory(robot), world, goal)))
        median = round(1000.0 * float(np.median(longest)), 1)
        tick = LongestTick(median, round(1000.0 * max(longest), 1), LIMIT_MS)
        results[f"longest executor tick, {name}"] = tick
    return results | {"planning in a tick, default": _counted(robot, situations)}


def _counted(robot: Robot, situations: int) -> PlannedPoints:
    """Count the points of planning in ticks: the same on every computer."""
    actions = SOCCER.actions()
    spent = [
        slices_of(planned, world, goal)
        for action, world, goal in hard_situations(robot, situations, seed=17)
        if isinstance(planned := actions[action].factory(robot), PlannedAction)
    ]
    return PlannedPoints(
        longest_points=max(sum(points) for slices in spent for points in slices),
        largest_portion_points=max(max(points, default=0) for slices in spent for points in slices),
        most_ticks=max(map(len, spent)),
        share_in_one_tick=round(float(np.mean([len(slices) == 1 for slices in spent])), 3),
        limit_longest_points=SLICE,
    )


def tick_times(action: Action, world: World, goal: Goal) -> list[float]:
    """Measure the processor time in s of each tick of an action whose robot follows every command."""
    began, times = time.process_time(), []
    try:
        with started(action, world, goal, "measured"):
            for _ in range(_TICKS):
                step = action.step(world)
                times.append(time.process_time() - began)
                if step.status is not Status.RUNNING:
                    break
                world = _after(action.robot, world, step.command or STOP)
                began = time.process_time()
    except ActionError:
        return [*times, time.process_time() - began]
    return times


def slices_of(action: PlannedAction, world: World, goal: Goal) -> list[list[int]]:
    """Plan to the end as from rest; return the points of the portions of each slice."""
    with ExitStack() as stack:
        with suppress(ActionError):
            stack.enter_context(started(action, world, goal, "measured"))
        return _searched(action, world)


def _searched(action: PlannedAction, world: World) -> list[list[int]]:
    """Return the points of the portions of each slice, of a search with the goal that `action` has got."""
    slices: list[list[int]] = []
    opening = opening_of(world.robot, action.plan_limits.aw)
    planning = action.plan(dataclasses.replace(world, robot=opening.end))
    search, found = Search(world, opening, planning, standing=True), None
    with suppress(ActionError):
        while found is None:
            slices.append([])
            found = search.advance(float(len(slices)), slices[-1])
    return slices


def hard_situations(robot: Robot, count: int, seed: int) -> Iterator[tuple[str, World, Goal]]:
    """Draw situations with posts, walls or the ball in the way: action, start and goal."""
    rng = np.random.default_rng(seed)
    field = field_of(robot)
    x_min, y_min, x_max, y_max = robot.scene.area.floor
    edges = ((x_min, x_max), (y_min, y_max), (-math.pi, math.pi))

    def anywhere() -> Pose:
        return Pose(*(float(rng.uniform(*low_high)) for low_high in edges))

    def at_post() -> Pose:
        post = field.length / 2, field.goal_width / 2
        x, y = (float(rng.choice((-1.0, 1.0)) * at + rng.normal(0.0, 0.35)) for at in post)
        return robot.scene.area.at(x, y, anywhere().yaw)

    def state(pose: Pose) -> RobotState:
        limits, moves = robot.limits, float(rng.random() < 0.5)
        v, w = (moves * float(rng.uniform(-most, most)) for most in (limits.v, limits.w))
        return RobotState(pose, v, w)

    for index in range(count):
        kind = index % 4
        if kind == 0:  # the ball at a post
            ball = at_post()
            world = World(
                0.0, state(anywhere()), {BALL: ObjectState(ball.x, ball.y, float(rng.normal()), 0.0)}
            )
            yield "goToPose", world, Goal(ball, 0.0, Point.HOLD)
        elif kind == 1:  # the ball beside the robot, itself at a post or not
            pose = at_post() if rng.random() < 0.5 else anywhere()
            ball = pose.ahead(float(rng.uniform(0.2, 0.8)))
            world = World(0.0, state(pose), {BALL: ObjectState(ball.x, ball.y, 0.0, float(rng.normal()))})
            yield "goToPose", world, Goal(anywhere())
        else:  # the ball held, somewhere or at a post
            pose = at_post() if rng.random() < 0.5 else anywhere()
            ball, v = (
                robot.hold_point(pose),
                float(rng.integers(2) * rng.uniform(0.0, robot.holder_for("dribbling").limits.v)),
            )
            world = World(0.0, RobotState(pose, v), {BALL: ObjectState(ball.x, ball.y)})
            side = 1 if rng.random() < 0.5 else -1
            mouth = Goal(Pose(*field.goal_centre(side), 0.0), 0.0, Point.HOLD)
            post = Goal(at_post(), 0.0, Point.HOLD)
            yield ("shoot", world, mouth) if kind == 2 else ("dribbleBall", world, post)


def _after(robot: Robot, world: World, command: Command) -> World:
    """Return the world a tick later; a ball in front stays there."""
    before, ball = world.robot, ball_of(world)
    speeds = ramped(Command(before.v, before.w), command, CONTROL_PERIOD, robot.limits, robot.stop)
    moved = before.pose.ahead(speeds.v * CONTROL_PERIOD)
    pose = moved._replace(yaw=moved.yaw + speeds.w * CONTROL_PERIOD)
    if ball is not None and not is_lost(world, robot, BALL):
        hold = robot.hold_point(pose)
        ball = ObjectState(hold.x, hold.y)
    elif ball is not None:
        ball = ball.after(CONTROL_PERIOD)
    return World(world.time + CONTROL_PERIOD, RobotState(pose, speeds.v, speeds.w), objects_of(ball))
