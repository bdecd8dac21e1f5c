"""Random situations with a chain to execute in them (paper, section 5)."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from ator_ros.actions.base import Goal
from ator_ros.domains.domain import ChainSampler
from ator_ros.domains.soccer.ball import BALL
from ator_ros.domains.soccer.field import field_of
from ator_ros.domains.soccer.situations import SHORTEST, is_inside, pose_within, random_pose
from ator_ros.domains.soccer.thresholds import ball_clearance, farthest
from ator_ros.geometry import Pose
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import ObjectState, RobotState, World

SHOOTING_DISTANCE = (1.2, 2.0)
"""Range in m of a shooting position's distance from the middle of the goal line."""
SHOOTING_BEARING = math.radians(50.0)
"""Greatest angle at the goal between a shooting position and the middle axis of the field."""
_OF_TWO = 0.3  # of the time limit, for the straight way of either part
ROLLING_SPEED = (0.5, 2.5)
"""Range in m/s of the speed of a ball that rolls at the start."""
_OPEN_HEADING = frozenset({"yaw"})


def dribble(robot: Robot, library: TopLibrary, rng: np.random.Generator) -> tuple[World, TopChain]:
    """Draw a ball to go to and to dribble to a pose: the chain of the paper's Table 1."""
    ball, world = _start(robot, rng)
    goal = pose_within(robot, rng, ball, SHORTEST, farthest(robot, _OF_TWO, with_ball=True))
    calls = (_call(library, "goToBall", ball, _OPEN_HEADING), _call(library, "dribbleBall", goal))
    return world, TopChain(calls)


def rolling(robot: Robot, library: TopLibrary, rng: np.random.Generator) -> tuple[World, TopChain]:
    """Draw the chain `dribble` with a ball that rolls; the plan knows where it is, not where it will rest.

    It rests before the robot could be there: no action of ours catches a ball in motion.
    """
    while True:
        world, chain = dribble(robot, library, rng)
        rest = chain.calls[0].goal.pose
        way, speed = rng.uniform(-math.pi, math.pi), rng.uniform(*ROLLING_SPEED)
        moving = ObjectState(rest.x, rest.y, speed * math.cos(way), speed * math.sin(way))
        there = robot.scene.at_rest(BALL, moving)
        soonest = world.robot.pose.distance(rest) / robot.limits.v
        now = Pose(2.0 * rest.x - there.x, 2.0 * rest.y - there.y, rest.yaw)
        apart = world.robot.pose.distance(now) >= ball_clearance(robot)
        if apart and is_inside(now, robot) and 2.0 * rest.distance(now) / speed <= soonest:
            break
    ball = ObjectState(now.x, now.y, moving.vx, moving.vy)
    goal = dataclasses.replace(chain.calls[0].goal, pose=now)
    return World(0.0, world.robot, {BALL: ball}), chain.with_goal(0, goal)


def shoot(robot: Robot, library: TopLibrary, rng: np.random.Generator) -> tuple[World, TopChain]:
    """Draw a ball to go to, to dribble before the goal and to shoot: the chain of the paper's Figure 1."""
    ball, world = _start(robot, rng)
    x, y = field_of(robot).goal_centre()
    position = ball
    while position.distance(ball) < SHORTEST:
        distance, bearing = rng.uniform(*SHOOTING_DISTANCE), rng.uniform(-SHOOTING_BEARING, SHOOTING_BEARING)
        position = Pose(x - distance * math.cos(bearing), y + distance * math.sin(bearing), -bearing)
    calls = (
        _call(library, "goToBall", ball, _OPEN_HEADING),
        _call(library, "dribbleBall", position, _OPEN_HEADING),
        _call(library, "shoot", Pose(x, y, 0.0)),
    )
    return world, TopChain(calls)


def drive(robot: Robot, library: TopLibrary, rng: np.random.Generator) -> tuple[World, TopChain]:
    """Draw a place to pass on the way to a pose, without a ball: every robot can drive there."""
    way = random_pose(robot, rng)
    goal = pose_within(robot, rng, way, SHORTEST, farthest(robot, _OF_TWO))
    start = pose_within(robot, rng, way, SHORTEST, farthest(robot, _OF_TWO))
    calls = (_call(library, "goToPose", way, _OPEN_HEADING), _call(library, "goToPose", goal))
    return World(0.0, RobotState(start)), TopChain(calls)


def _start(robot: Robot, rng: np.random.Generator) -> tuple[Pose, World]:
    """Draw a ball, and a robot at rest that does not touch it."""
    ball = random_pose(robot, rng)
    start = pose_within(robot, rng, ball, ball_clearance(robot), farthest(robot, _OF_TWO))
    return ball, World(0.0, RobotState(start), {BALL: ObjectState(ball.x, ball.y)})


def _call(library: TopLibrary, top: str, pose: Pose, opened: frozenset[str] = frozenset()) -> TopCall:
    return TopCall(library[top], Goal(pose, 0.0, library[top].point), opened)


CHAINS: Mapping[str, ChainSampler] = MappingProxyType(
    {"dribble": dribble, "drive": drive, "rolling": rolling, "shoot": shoot}
)
