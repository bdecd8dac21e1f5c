"""The domain `drive`: a robot drives to poses; there are no objects."""

from __future__ import annotations

import dataclasses
from functools import partial

import numpy as np

from ator_ros.actions import DEFAULT_SET, TIME_LIMIT
from ator_ros.actions.base import Goal
from ator_ros.actions.situation import ActionSpec, Situation, short_goal
from ator_ros.bases.description import Robot
from ator_ros.domains.domain import Domain
from ator_ros.domains.places import (
    OF_TWO,
    SHORTEST,
    farthest,
    is_inside,
    pose_within,
    random_pose,
    random_start,
)
from ator_ros.domains.planned.planar_go_to_pose import planned_go_to_pose
from ator_ros.resources import resource_path
from ator_ros.tops.chain import Top, TopCall, TopChain
from ator_ros.tops.conditions import Condition, Term
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.ranges import USUAL_RANGES, Ranges, arrival_speed
from ator_ros.world.state import CONTROL_PERIOD, RobotState, World

_LONG_TIME_LIMIT = 120.0  # s that a drive or a chain may take: at 0.05 m/s a robot drives 6 m
_TOLERANCE = 0.06  # m: least tolerance of a place, 1 cm more than that of the action
_BESIDE_PATH = 0.01  # m: greatest distance from the path of a robot that passes its goal
# greatest arrival speed, in situations and searches, as a share of the limit
_ARRIVAL_SHARE = 2.0 / 3.0

_AT_GOAL = (
    Term("robot.x", "goal.x", _TOLERANCE),
    Term("robot.y", "goal.y", _TOLERANCE),
    Term("robot.yaw", "goal.yaw", 0.12),
)
GO_TO_POSE = Top("goToPose", "goToPose", Condition(), Condition(_AT_GOAL))
"""Drive to a pose of the axle."""


def arrival_limit(robot: Robot) -> float:
    """Return the greatest arrival speed in m/s."""
    return _ARRIVAL_SHARE * robot.greatest_speed()


RANGES: Ranges = {
    **USUAL_RANGES,
    "speed": lambda robot, goal: arrival_speed(robot, goal, most=arrival_limit(robot)),
}


def go_to_pose(robot: Robot, rng: np.random.Generator) -> Situation:
    """Draw a drive to a pose; every second goal that is not near the start has an arrival speed."""
    goal = random_pose(robot, rng)
    start = random_start(robot, rng, goal, SHORTEST, time_limit=_LONG_TIME_LIMIT)
    short = short_goal(start.pose, rng)
    if short is not None and is_inside(short, robot):
        return Situation("goToPose", RobotState(start.pose), {}, Goal(short))
    speed = float(rng.uniform(0.0, arrival_limit(robot))) if rng.random() < 0.5 else 0.0
    return Situation("goToPose", start, {}, Goal(goal, speed))


def two_drives(
    robot: Robot,
    library: TopLibrary,
    rng: np.random.Generator,
    *,
    time_limit: float = TIME_LIMIT,
) -> tuple[World, TopChain]:
    """Draw a chain of two drives to poses; the heading between them is open.

    Straight paths take at most 0.3 of `time_limit` (s) each. Raises NoPlaceError without room.
    """
    stop = random_pose(robot, rng)
    most = farthest(robot, OF_TWO, SHORTEST, time_limit=time_limit)
    goal = pose_within(robot, rng, stop, SHORTEST, most)
    start = pose_within(robot, rng, stop, SHORTEST, most)
    top = library["goToPose"]
    calls = (TopCall(top, Goal(stop), frozenset({"yaw"})), TopCall(top, Goal(goal)))
    return World(0.0, RobotState(start)), TopChain(calls)


def tops_for(robot: Robot) -> tuple[Top, ...]:
    """Return the TOPs: their tolerance includes how far the robot drives in a tick at arrival."""
    tolerance = max(_TOLERANCE, arrival_limit(robot) * CONTROL_PERIOD + _BESIDE_PATH)
    terms = (
        Term(term.variable, term.target, tolerance)
        if term.variable in ("robot.x", "robot.y")
        else term
        for term in GO_TO_POSE.post.terms
    )
    return (dataclasses.replace(GO_TO_POSE, post=Condition(tuple(terms))),)


DRIVE = Domain(
    "drive",
    (GO_TO_POSE,),
    {DEFAULT_SET: (ActionSpec("goToPose", planned_go_to_pose, go_to_pose),)},
    chains={"passing": partial(two_drives, time_limit=_LONG_TIME_LIMIT)},
    variables=RANGES,
    description=resource_path("config", "turtlebot4.yaml"),
    time_limit=_LONG_TIME_LIMIT,
    fitted=tops_for,
)
