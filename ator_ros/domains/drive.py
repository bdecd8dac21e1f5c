"""The domain `drive`: a robot with two driven wheels drives to poses; there are no objects."""

from __future__ import annotations

import dataclasses
from functools import partial

import numpy as np

from ator_ros.actions import DEFAULT_SET
from ator_ros.actions.situation import SHORT, ActionSpec, Situation
from ator_ros.bases.description import Robot
from ator_ros.domains.domain import Domain
from ator_ros.domains.soccer import chains, samplers
from ator_ros.domains.soccer.planned.go_to_pose import GoToPose
from ator_ros.domains.soccer.tops import GO_TO_POSE
from ator_ros.resources import resource_path
from ator_ros.tops.chain import Top
from ator_ros.tops.conditions import Condition, Term
from ator_ros.tops.ranges import USUAL_RANGES, Ranges, arrival_speed
from ator_ros.world.state import CONTROL_PERIOD

TIME_LIMIT = 120.0
"""Time in s that a drive or a chain may take: at 0.05 m/s a robot drives 6 m."""
# m: least tolerance of a place, greatest distance from the path
_TOLERANCE, _BESIDE_PATH = 0.06, 0.01
# greatest arrival speed, in situations and searches, as a share of the limit
_ARRIVAL_SHARE = 2.0 / 3.0


def arrival_limit(robot: Robot) -> float:
    """Return the greatest arrival speed in m/s."""
    return _ARRIVAL_SHARE * robot.greatest_speed()


RANGES: Ranges = {
    **USUAL_RANGES,
    "speed": lambda robot, goal: arrival_speed(robot, goal, most=arrival_limit(robot)),
}


def go_to_pose(robot: Robot, rng: np.random.Generator) -> Situation:
    """Draw a drive to a pose; every second goal that is not near the start has an arrival speed."""
    situation = samplers.go_to_pose(robot, rng, time_limit=TIME_LIMIT)
    if situation.robot.pose.distance(situation.goal.pose) < SHORT:
        return situation
    speed = float(rng.uniform(0.0, arrival_limit(robot))) if rng.random() < 0.5 else 0.0
    return dataclasses.replace(situation, goal=dataclasses.replace(situation.goal, speed=speed))


def tops_for(robot: Robot) -> tuple[Top, ...]:
    """Return the TOPs, whose tolerance includes how far the robot drives in a tick at its arrival speed."""
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
    {DEFAULT_SET: (ActionSpec("goToPose", GoToPose, go_to_pose),)},
    chains={"passing": partial(chains.drive, time_limit=TIME_LIMIT)},
    variables=RANGES,
    description=resource_path("config", "turtlebot4.yaml"),
    time_limit=TIME_LIMIT,
    fitted=tops_for,
)
