"""Samplers make few draws, and only tasks that the robot can do within the time limit."""

import dataclasses
import itertools
from collections.abc import Callable

import numpy as np
import pytest
from robots import HEAVY, PIONEER, PLAIN

from ator_ros.actions import TIME_LIMIT
from ator_ros.actions.situation import NoPlaceError
from ator_ros.bases.description import Robot
from ator_ros.domains.domain import find_domain
from ator_ros.domains.soccer.field import BALL
from ator_ros.tops.chain import TopChain
from ator_ros.world.state import World

SOCCER = find_domain("soccer")


def at_speed(v: float, robot: Robot = PIONEER) -> Robot:
    def slow(limits: object) -> object:
        return dataclasses.replace(limits, v=v)  # type: ignore[type-var]

    holder = robot.holder and dataclasses.replace(robot.holder, limits=slow(robot.holder.limits))
    return dataclasses.replace(robot, limits=slow(robot.limits), holder=holder)


SLOW_ONES = (at_speed(0.05), at_speed(0.05, PLAIN), at_speed(0.12, HEAVY))


def drawn_chain(name: str, robot: Robot, rng: np.random.Generator) -> tuple[World, TopChain]:
    return SOCCER.chains[name](robot, SOCCER.library(robot), rng)


SAMPLERS: dict[str, Callable[[Robot, np.random.Generator], object]] = {
    **{action: spec.sample for action, spec in SOCCER.actions().items()},
    "bezier shoot": SOCCER.actions("bezier")["shoot"].sample,
    **{
        f"chain {name}": lambda robot, rng, name=name: drawn_chain(name, robot, rng)
        for name in SOCCER.chains
    },
}


@pytest.mark.parametrize("name", [name for name in SAMPLERS if "shoot" not in name])
def test_a_scene_without_enough_space_is_reported(name: str) -> None:
    area = dataclasses.replace(PIONEER.scene.area, length=2.0, width=1.0)
    robot = dataclasses.replace(
        PIONEER, scene=dataclasses.replace(PIONEER.scene, area=area, bays=())
    )
    expected = "^scene.area: got 2 x 1 m, of whose lines robot pioneer_3dx keeps 0.90 m"
    with pytest.raises(NoPlaceError, match=expected):
        SAMPLERS[name](robot, np.random.default_rng(0))


@pytest.mark.parametrize("name", SAMPLERS)
def test_a_robot_too_slow_for_the_time_limit_is_reported(name: str) -> None:
    with pytest.raises(
        NoPlaceError, match=r"^limits.v: expected 0.0\d+ m/s .*, got 0.01 m/s of robot"
    ):
        SAMPLERS[name](at_speed(0.01), np.random.default_rng(0))


@pytest.mark.parametrize("robot", SLOW_ONES, ids=lambda robot: robot.name)
@pytest.mark.parametrize("action", ["goToPose", "dribbleBall"])
def test_no_drive_exceeds_the_time_limit_on_a_straight_line(robot: Robot, action: str) -> None:
    if robot.holder is None and action != "goToPose":
        return
    rng, sample = np.random.default_rng(1), SOCCER.actions()[action].sample
    for _ in range(100):
        drawn = sample(robot, rng)
        distance = drawn.robot.pose.distance(drawn.goal.robot_pose(robot))
        assert distance <= 0.9 * TIME_LIMIT * robot.limits.v


@pytest.mark.parametrize("name", SOCCER.chains)
def test_no_chain_of_a_slow_robot_exceeds_the_time_limit(name: str) -> None:
    robot, rng = at_speed(0.12), np.random.default_rng(1)
    for _ in range(5):
        world, chain = drawn_chain(name, robot, rng)
        goals = [call.goal for call in chain.calls if call.top.name != "shoot"]
        if name == "rolling":  # the goal is where the ball comes to rest
            rest = robot.scene.at_rest(BALL, world.objects[BALL])
            goals[0] = dataclasses.replace(
                goals[0], pose=goals[0].pose._replace(x=rest.x, y=rest.y)
            )
        places = [world.robot.pose, *(goal.robot_pose(robot) for goal in goals)]
        distance = sum(one.distance(other) for one, other in itertools.pairwise(places))
        assert distance <= TIME_LIMIT * robot.limits.v
