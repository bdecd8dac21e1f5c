"""A small domain for tests: a robot transports between two objects, without ball or field."""

import math

import numpy as np
from turning_action import TurnDriveTurn

from ator_ros.actions.base import Goal
from ator_ros.actions.situation import ActionSpec, Situation
from ator_ros.domains.domain import Domain
from ator_ros.geometry import Pose
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import Top, TopCall, TopChain
from ator_ros.tops.conditions import Condition, Term
from ator_ros.tops.library import TopLibrary
from ator_ros.world.scene import RoundObject
from ator_ros.world.state import ObjectState, RobotState, World


class Carry(TurnDriveTurn):
    name = "carry"


CARRY = Top(
    "carryOver",
    "carry",
    Condition((Term("box.x", "cart.x", 9.0), Term("box.y", "cart.y", 9.0))),
    Condition((Term("robot.x", "goal.x", 0.1), Term("robot.y", "goal.y", 0.1))),
)


def place(rng: np.random.Generator) -> Pose:
    return Pose(*(float(rng.uniform(-most, most)) for most in (1.0, 1.0, math.pi)))


def objects(rng: np.random.Generator) -> dict[str, ObjectState]:
    """Draw both objects, away from the robot's path."""
    return {"box": ObjectState(3.0, float(rng.uniform(1.5, 2.0))), "cart": ObjectState(-3.0, -2.0)}


def drive(robot: Robot, rng: np.random.Generator) -> Situation:
    """Draw a drive beside both objects."""
    return Situation("carry", RobotState(place(rng)), objects(rng), Goal(place(rng)))


def two_legs(robot: Robot, library: TopLibrary, rng: np.random.Generator) -> tuple[World, TopChain]:
    """Draw two drives, the heading between them open."""
    calls = (
        TopCall(library["carryOver"], Goal(place(rng)), frozenset({"yaw"})),
        TopCall(library["carryOver"], Goal(place(rng))),
    )
    return World(0.0, RobotState(place(rng)), objects(rng)), TopChain(calls)


def one_leg(robot: Robot, library: TopLibrary, rng: np.random.Generator) -> tuple[World, TopChain]:
    """Draw a single drive, its heading open."""
    call = TopCall(library["carryOver"], Goal(place(rng)), frozenset({"yaw"}))
    return World(0.0, RobotState(place(rng)), objects(rng)), TopChain((call,))


PARCELS = Domain(
    "parcels",
    tops=(CARRY,),
    action_sets={"default": (ActionSpec("carry", Carry, drive),)},
    objects=("box", "cart"),
    bodies=dict.fromkeys(("box", "cart"), RoundObject(0.1, 0.4, 0.7, 0.1)),
    chains={"two_legs": two_legs, "one_leg": one_leg},
)
