"""An external domain: places to visit and a parcel, with an independent action.

Its goals have their own variable `cruise`: the maximum speed of the drive.
"""

from __future__ import annotations

import math

import numpy as np

from ator_ros.actions.base import Action, Goal, Status, Step, finished
from ator_ros.actions.goal_variables import GoalVariable
from ator_ros.actions.situation import ActionSpec, Situation
from ator_ros.bases.description import Robot
from ator_ros.domains.domain import Domain
from ator_ros.geometry import FloatArray, Pose, wrap_angle
from ator_ros.performance.derived import Geometry
from ator_ros.performance.features import Feature, variables
from ator_ros.tops.chain import Top, TopCall, TopChain
from ator_ros.tops.conditions import Condition, Distance, Region, Term
from ator_ros.tops.library import TopLibrary
from ator_ros.world.scene import RoundObject
from ator_ros.world.state import Command, ObjectState, RobotState, World

CRUISE = GoalVariable("cruise", "m/s", 0.2, 1.0)


class TurnDriveTurn(Action):
    """Turns to the goal, drives there at up to `cruise`, turns to the goal's heading."""

    name = "turnDriveTurn"

    def start(self, world: World, goal: Goal) -> None:
        self._goal = goal.robot_pose(self.robot)
        self._cruise = goal.values.get(CRUISE.name, CRUISE.high)

    def step(self, world: World) -> Step:
        pose = world.robot.pose
        if pose.distance(self._goal) > 0.04:
            turn = wrap_angle(math.atan2(self._goal.y - pose.y, self._goal.x - pose.x) - pose.yaw)
            speed = min(self._cruise, pose.distance(self._goal)) * max(0.0, math.cos(turn)) ** 4
            return Step(Command(speed, self._turn(turn)), Status.RUNNING, "driving")
        turn = wrap_angle(self._goal.yaw - pose.yaw)
        if abs(turn) > 0.05 or abs(world.robot.w) > 0.1:
            return Step(Command(0.0, self._turn(turn)), Status.RUNNING, "turning")
        return finished(Status.SUCCEEDED, "arrived")

    def _turn(self, angle: float) -> float:
        limit = self.robot.limits.w
        return max(-limit, min(limit, 3.0 * angle))


_THERE = Condition(
    (
        Term("robot.x", "goal.x", 0.1),
        Term("robot.y", "goal.y", 0.1),
        Term("robot.yaw", "goal.yaw", 0.2),
    )
)
VISIT = Top("visit", "turnDriveTurn", Condition(), _THERE)
PASS = Top(
    "pass",
    "turnDriveTurn",
    # The start is not faster than `cruise`, and clear of the parcel.
    Condition(
        (Region("robot.vx", "goal.cruise", high=0.0),), (Distance("robot", "parcel", low=0.5),)
    ),
    _THERE,
)


def _place(rng: np.random.Generator) -> Pose:
    return Pose(*(float(rng.uniform(-most, most)) for most in (2.5, 1.5, math.pi)))


PARCEL = RoundObject(radius=0.25, mass=1.5, rolling_deceleration=2.0, restitution=0.2)


def _parcel(rng: np.random.Generator) -> dict[str, ObjectState]:
    """Draw a parcel outside of all driven paths."""
    return {"parcel": ObjectState(3.4, float(rng.uniform(-2.0, 2.0)))}


def drive(robot: Robot, rng: np.random.Generator) -> Situation:
    """Draw a start and a goal, both at rest, and a parcel."""
    start, parcel = RobotState(_place(rng)), _parcel(rng)
    return Situation(
        "turnDriveTurn", start, parcel, _goal(rng, float(rng.uniform(CRUISE.low, CRUISE.high)))
    )


def _goal(rng: np.random.Generator, cruise: float) -> Goal:
    return Goal(_place(rng), values={CRUISE.name: cruise})


def two_visits(
    robot: Robot, library: TopLibrary, rng: np.random.Generator
) -> tuple[World, TopChain]:
    """Draw two places to visit; the heading at the first and the speed to it are open."""
    calls = (
        TopCall(library["visit"], _goal(rng, 0.5), frozenset({"yaw", CRUISE.name})),
        TopCall(library["pass"], _goal(rng, 0.8)),
    )
    return World(0.0, RobotState(_place(rng)), _parcel(rng)), TopChain(calls)


def _turning(geometry: Geometry) -> FloatArray:
    """Return the sum of both turns on the spot in rad."""
    return np.abs(geometry.to_dest) + np.abs(geometry.at_dest)


_WAY = variables("x y yaw xg yg yawg hold")
TURNED = Feature("turned", "rad", _WAY, _turning)
CRUISED = Feature("cruised", "s", _WAY | {"cruiseg"}, lambda g: g.dist / g.direct["cruiseg"])
_FEATURES = (TURNED.name, CRUISED.name)

DELIVERY = Domain(
    "delivery",
    tops=(VISIT, PASS),
    action_sets={
        "default": (
            ActionSpec("turnDriveTurn", TurnDriveTurn, drive, _FEATURES, goal_variables=(CRUISE,)),
        )
    },
    objects=("parcel",),
    bodies={"parcel": PARCEL},
    chains={"two_visits": two_visits},
    features=(TURNED, CRUISED),
)
