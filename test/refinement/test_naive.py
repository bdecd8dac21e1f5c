"""Naive values of open variables without models: those of straight lines or routes."""

import dataclasses
import math

import pytest
from maps import hall_map
from refinement_fakes import ANGLE, BOTH, LIBRARY, ROBOT, call, world

from ator_ros.actions.base import Goal
from ator_ros.domains.domain import find_domain
from ator_ros.geometry import Pose
from ator_ros.refinement.naive import naive_on_paths
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.conditions import Condition, Region
from ator_ros.world.state import RobotState, World


def yaws(chain: TopChain) -> list[float]:
    return [step.goal.pose.yaw for step in chain.calls]


def test_an_open_heading_is_that_in_which_the_robot_arrives() -> None:
    sent = TopChain(
        (
            call("goToPose", 0.0, 1.0, 2.0, BOTH, speed=0.3),
            call("goToPose", 0.0, 2.0, 2.0),
            call("goToPose", 0.0, 2.0, 1.0, ANGLE),
            call("goToPose", -1.0, 2.0, 1.0, ANGLE),
        )
    )
    found = naive_on_paths(world(), sent, ROBOT, LIBRARY.ranges)
    # the third step starts at its goal, and keeps the heading there
    assert yaws(found) == pytest.approx([math.pi / 4, 2.0, 2.0, math.pi])
    assert found.calls[0].goal.speed == 0.0


def test_it_follows_the_route_on_a_map() -> None:
    tour = find_domain("tour")
    robot = dataclasses.replace(tour.robot(), grid=hall_map())
    visit = tour.library(robot)["visit"]
    chain = TopChain((TopCall(visit, Goal(Pose(3.0, 0.0, 0.0)), ANGLE),))
    start = World(0.0, RobotState(Pose(-3.0, 0.0, 0.0)))
    assert -1.2 < yaws(naive_on_paths(start, chain, robot, tour.ranges))[0] < -0.3


def test_a_chain_that_opens_nothing_and_an_invalid_value_are_kept() -> None:
    nothing = TopChain((call("goToPose", 1.0, 1.0, 2.0),))
    assert naive_on_paths(world(), nothing, ROBOT, LIBRARY.ranges) is nothing
    # the second step may only start in other headings than that in which the robot arrives
    watch = dataclasses.replace(
        LIBRARY["goToPose"], name="watch", pre=Condition((Region("robot.yaw", 2.0, -0.5, 0.5),))
    )
    sent = TopChain(
        (
            call("goToPose", 0.0, 1.0, 2.0, ANGLE),
            TopCall(watch, Goal(Pose(1.0, 1.0, 2.0)), ANGLE),
        )
    )
    found = naive_on_paths(world(), sent, ROBOT, LIBRARY.ranges)
    assert yaws(found) == pytest.approx([2.0, 0.0])
    assert not found.violations(world(), ROBOT)


def test_a_value_is_kept_that_a_step_needs_after_another_step() -> None:
    arrive = LIBRARY["goToPose"]
    wait = dataclasses.replace(arrive, name="wait", post=Condition(()))  # moves nothing
    watch = dataclasses.replace(arrive, pre=Condition((Region("robot.yaw", 2.0, -0.5, 0.5),)))
    there = Goal(Pose(0.0, 1.0, 2.0))
    sent = TopChain(
        (TopCall(arrive, there, ANGLE), TopCall(wait, there), TopCall(watch, there, ANGLE))
    )
    assert yaws(naive_on_paths(world(), sent, ROBOT, LIBRARY.ranges))[0] == 2.0
    free = TopChain(sent.calls[:2])
    assert yaws(naive_on_paths(world(), free, ROBOT, LIBRARY.ranges))[0] != 2.0
