"""Random situations with a chain to execute in them (paper, section 5)."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from ator_ros.actions.base import Goal
from ator_ros.actions.situation import Situation, drawn_until
from ator_ros.bases.description import Robot
from ator_ros.domains.domain import ChainSampler
from ator_ros.domains.drive import two_drives
from ator_ros.domains.places import (
    OF_TWO,
    SHORTEST,
    distance_when_held,
    farthest,
    is_inside,
    pose_within,
    random_pose,
)
from ator_ros.domains.soccer.field import BALL, field_of
from ator_ros.domains.soccer.samplers import with_room
from ator_ros.domains.soccer.thresholds import ball_clearance
from ator_ros.geometry import Pose
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import ObjectState, RobotState, World

_SHOOTING_DISTANCE = (1.2, 2.0)  # m from the middle of the goal line to a shooting position
_SHOOTING_BEARING = math.radians(50.0)  # greatest angle of that direction to the axis of the field
_ROLLING_SPEED = (0.5, 2.5)  # m/s of a ball that rolls at the start
_OPEN_HEADING = frozenset({"yaw"})


def dribble(
    robot: Robot,
    library: TopLibrary,
    rng: np.random.Generator,
) -> tuple[World, TopChain]:
    """Draw the chain of the paper's Table 1: go to the ball, dribble it to a pose.

    Returns the state at the start, and the chain with its open variables. Raises NoPlaceError
    without room.
    """
    ball, world = _start(robot, rng)
    most = farthest(robot, OF_TWO, SHORTEST, holding=True)
    goal = pose_within(robot, rng, ball, SHORTEST, most, held=True)
    calls = (_call(library, "goToBall", ball, _OPEN_HEADING), _call(library, "dribbleBall", goal))
    return world, TopChain(calls)


def rolling(
    robot: Robot,
    library: TopLibrary,
    rng: np.random.Generator,
) -> tuple[World, TopChain]:
    """Draw the chain `dribble` with a ball that rolls.

    The ball comes to rest before the robot can arrive. The goal of the first step is the present
    place of the ball.
    """

    def drawn() -> tuple[World, TopChain, ObjectState]:
        world, chain = dribble(robot, library, rng)
        rest = chain.calls[0].goal.pose
        heading = rng.uniform(-math.pi, math.pi)
        speed = rng.uniform(*_ROLLING_SPEED)
        moving = ObjectState(
            rest.x,
            rest.y,
            speed * math.cos(heading),
            speed * math.sin(heading),
        )
        there = robot.scene.at_rest(BALL, moving)
        x = 2.0 * rest.x - there.x
        y = 2.0 * rest.y - there.y
        return world, chain, ObjectState(x, y, moving.vx, moving.vy)

    def rests_in_time(found: tuple[World, TopChain, ObjectState]) -> bool:
        world, chain, ball = found
        rest = chain.calls[0].goal.pose
        start = world.robot.pose
        now = Pose(ball.x, ball.y, rest.yaw)
        speed = math.hypot(ball.vx, ball.vy)
        soonest = start.distance(rest) / robot.greatest_speed()
        apart = start.distance(now) >= ball_clearance(robot)
        rolls_for = 2.0 * rest.distance(now) / speed
        return apart and is_inside(now, robot) and rolls_for <= soonest

    world, chain, ball = drawn_until(
        drawn,
        rests_in_time,
        lambda: _expected(robot, "a ball that rolls there"),
    )
    now = chain.calls[0].goal.pose._replace(x=ball.x, y=ball.y)
    goal = dataclasses.replace(chain.calls[0].goal, pose=now)
    return World(0.0, world.robot, {BALL: ball}), chain.with_goal(0, goal)


def shoot(
    robot: Robot,
    library: TopLibrary,
    rng: np.random.Generator,
) -> tuple[World, TopChain]:
    """Draw the chain of the paper's Figure 1: go to the ball, dribble it before the goal, shoot.

    Returns the state at the start, and the chain with its open variables. Raises NoPlaceError
    without room.
    """
    most = farthest(robot, OF_TWO, SHORTEST, holding=True)

    def dribbled(chain: TopChain) -> float:
        return distance_when_held(
            robot,
            chain.calls[0].goal.pose,
            chain.calls[1].goal.pose,
        )

    def in_reach() -> tuple[World, TopChain]:
        return drawn_until(
            lambda: _shot(robot, library, rng),
            lambda drawn: dribbled(drawn[1]) <= most,
            lambda: _expected(robot, f"to dribble {most:.2f} m at most before the goal"),
        )

    if robot.holder is None:  # reported by the TOPs
        return in_reach()
    return with_room(robot, in_reach, lambda drawn: _last_shot(robot, drawn[1]))


def _shot(
    robot: Robot,
    library: TopLibrary,
    rng: np.random.Generator,
) -> tuple[World, TopChain]:
    ball, world = _start(robot, rng)
    x, y = field_of(robot).goal_center()

    def position() -> Pose:
        distance = rng.uniform(*_SHOOTING_DISTANCE)
        bearing = rng.uniform(-_SHOOTING_BEARING, _SHOOTING_BEARING)
        return Pose(
            x - distance * math.cos(bearing),
            y + distance * math.sin(bearing),
            -bearing,
        )

    def is_usable(place: Pose) -> bool:
        far = place.distance(ball) >= SHORTEST
        return far and robot.scene.area.has_floor(place.x, place.y)

    there = drawn_until(
        position,
        is_usable,
        lambda: _expected(robot, "a place for a shot before the goal"),
    )
    calls = (
        _call(library, "goToBall", ball, _OPEN_HEADING),
        _call(library, "dribbleBall", there, _OPEN_HEADING),
        _call(library, "shoot", Pose(x, y, 0.0)),
    )
    return world, TopChain(calls)


def _last_shot(robot: Robot, chain: TopChain) -> Situation:
    """Return the situation of a chain's shot if the dribble before it ends at its goal."""
    _, dribbling, shot = chain.calls
    held = dribbling.goal.pose
    ball = {BALL: ObjectState(held.x, held.y)}
    return Situation(
        shot.top.action,
        RobotState(robot.pose_holding(held)),
        ball,
        shot.goal,
    )


def _start(robot: Robot, rng: np.random.Generator) -> tuple[Pose, World]:
    """Draw a ball, and a robot at rest that does not touch it."""
    ball = random_pose(robot, rng)
    nearest = ball_clearance(robot)
    start = pose_within(robot, rng, ball, nearest, farthest(robot, OF_TWO, nearest))
    return ball, World(0.0, RobotState(start), {BALL: ObjectState(ball.x, ball.y)})


def _expected(robot: Robot, what: str) -> str:
    area = robot.scene.area
    return (
        f"scene.area: expected {what} for robot {robot.name} at {robot.greatest_speed():g} m/s, "
        f"got {area.length:g} x {area.width:g} m"
    )


def _call(
    library: TopLibrary,
    top: str,
    pose: Pose,
    opened: frozenset[str] = frozenset(),
) -> TopCall:
    return TopCall(
        library[top],
        Goal(pose, 0.0, library[top].point),
        opened,
    )


CHAINS: Mapping[str, ChainSampler] = MappingProxyType(
    {
        "dribble": dribble,
        "drive": two_drives,
        "rolling": rolling,
        "shoot": shoot,
    }
)
"""The chains of the domain by name."""
