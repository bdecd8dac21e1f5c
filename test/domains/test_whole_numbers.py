"""Whole numbers are read as floats: by actions, refinement and simulation."""

import pytest

from ator_ros.actions.base import Goal
from ator_ros.bases.description import load_robot
from ator_ros.domains.domain import find_domain
from ator_ros.domains.soccer.field import BALL
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.geometry import Pose
from ator_ros.performance.model_file import load_models
from ator_ros.refinement.refiner import Refiner
from ator_ros.simulation.scene_simulation import Simulation
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.objects import held_first, objects_in
from ator_ros.world.state import ObjectState, RobotState, World

ROBOT = load_robot()
OPEN = frozenset({"yaw", "speed"})


@pytest.mark.parametrize("domain", ["soccer", "drive", "tour", "pursuit"])
def test_every_action_starts_at_whole_numbers(domain: str) -> None:
    found = find_domain(domain)
    library = found.library(found.robot())
    started = 0
    for top in library.usable():
        if top.name == "goToPose" and domain == "soccer":
            continue  # the ball is in its way
        goal = library.goal(top, Pose(1, 1, 0))
        world = at_whole_numbers(library, top.name)
        action = library.action(top)
        action.setup()
        action.start(world, goal)
        action.step(world)
        started += 1
    assert started


def at_whole_numbers(library: TopLibrary, name: str) -> World:
    robot, top = library.robot, library[name]
    place = robot.hold_point(Pose(0, 0, 0)) if held_first(top) else Pose(1, 1, 0)
    there = ObjectState(place.x, place.y, 0, 0)
    return World(0, RobotState(Pose(0, 0, 0), 0, 0), dict.fromkeys(objects_in(top), there))


def test_a_chain_of_whole_numbers_is_refined_as_one_of_floats() -> None:
    library = SOCCER.library(ROBOT)
    refiner = Refiner(ROBOT, load_models(ROBOT, SOCCER.known_features), ranges=SOCCER.ranges)
    answers = []
    for number in (int, float):
        zero, two = number(0), number(2)
        world = World(
            zero,
            RobotState(Pose(-two, zero, zero), zero, zero),
            {BALL: ObjectState(zero, zero, zero, zero)},
        )
        places = ("goToBall", Pose(zero, zero, zero)), ("dribbleBall", Pose(zero, two, zero))
        chain = TopChain(
            tuple(
                TopCall(library[top], Goal(place, zero, library[top].point), OPEN)
                for top, place in places
            )
        )
        answers.append(refiner.refine(world, chain, placeholders=True))
    first, second = answers
    assert first.reason == second.reason
    assert first.chain == second.chain


def test_the_simulation_starts_at_whole_numbers() -> None:
    simulation = Simulation(ROBOT)
    simulation.place_robot(Pose(0, 0, 0))
    simulation.place_object(BALL, 1, 1)
    simulation.tick()
    assert simulation.world().robot.pose == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)
