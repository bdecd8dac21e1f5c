"""Areas at any position: decisions and executions depend only on positions relative to the area."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from robots import PIONEER, loaded

from ator_ros.bases.description import Robot
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.execution.fence import Fence
from ator_ros.geometry import Pose
from ator_ros.performance.model_file import load_model
from ator_ros.refinement.refiner import Refiner
from ator_ros.resources import resource_path
from ator_ros.tops.chain import TopChain
from ator_ros.world.state import World

UTM = (5e5, 5e6)


def moved_robot(x: float, y: float) -> Robot:
    scene = PIONEER.scene
    bays = tuple(dataclasses.replace(bay, x=bay.x + x, y=bay.y + y) for bay in scene.bays)
    area = dataclasses.replace(scene.area, x=x, y=y)
    return SOCCER.equip(
        dataclasses.replace(PIONEER, scene=dataclasses.replace(scene, area=area, bays=bays))
    )


def moved_world(world: World, x: float, y: float) -> World:
    pose = world.robot.pose
    there = pose._replace(x=pose.x + x, y=pose.y + y)
    objects = {
        name: dataclasses.replace(state, x=state.x + x, y=state.y + y)
        for name, state in world.objects.items()
    }
    return World(world.time, dataclasses.replace(world.robot, pose=there), objects)


def moved_chain(chain: TopChain, robot: Robot, x: float, y: float) -> TopChain:
    library = SOCCER.library(robot)
    calls = []
    for call in chain.calls:
        pose = call.goal.pose._replace(x=call.goal.pose.x + x, y=call.goal.pose.y + y)
        goal = dataclasses.replace(call.goal, pose=pose)
        calls.append(dataclasses.replace(call, top=library[call.top.name], goal=goal))
    return TopChain(tuple(calls))


def refiner(robot: Robot) -> Refiner:
    folder = resource_path("models")
    models = {
        name: load_model(folder / f"{name}.json", robot, SOCCER.known_features)
        for name in ("goToPose", "dribbleBall", "shoot")
    }
    return Refiner(robot, models, ranges=SOCCER.ranges)


@pytest.mark.parametrize("name", ["dribble", "shoot"])
def test_refinement_and_execution_do_not_depend_on_the_area_position(name: str) -> None:
    there, opened = moved_robot(*UTM), frozenset({"yaw", "speed"})
    world, chain = SOCCER.chains[name](PIONEER, SOCCER.library(PIONEER), np.random.default_rng(3))
    chain = TopChain((dataclasses.replace(chain.calls[0], open=opened), *chain.calls[1:]))
    here = refiner(PIONEER).refine(world, chain, placeholders=True)
    away = refiner(there).refine(
        moved_world(world, *UTM), moved_chain(chain, there, *UTM), placeholders=True
    )
    assert (away.refined, away.reason) == (here.refined, here.reason)
    assert away.after.cost == pytest.approx(here.after.cost, abs=1e-4)
    expected = moved_chain(here.chain, there, *UTM)
    for call, planned in zip(away.chain.calls, expected.calls, strict=True):
        assert call.goal.pose == pytest.approx(planned.goal.pose, abs=1e-6)
        assert call.goal.speed == pytest.approx(planned.goal.speed, abs=1e-6)
    ran = run_chain(PIONEER, SOCCER.library(PIONEER), world, here.chain)
    run_away = run_chain(there, SOCCER.library(there), moved_world(world, *UTM), away.chain)
    assert ran.success
    assert run_away.success, run_away.reason
    assert run_away.actions == pytest.approx(ran.actions, abs=0.051)


def test_free_places_and_fence_move_with_the_area() -> None:
    there = moved_robot(*UTM)
    goal = SOCCER.library(there).goal(SOCCER.library(there)["goToPose"], Pose(*UTM, 0.0))
    x, y = (SOCCER.ranges[name](there, goal) for name in "xy")
    assert (x.low, x.high, y.low, y.high) == (499_996.0, 500_004.0, 4_999_997.5, 5_000_002.5)
    assert Fence.around(there) == Fence(499_995.0, 4_999_996.5, 500_005.0, 5_000_003.5)
    assert x.contains(500_004.0)
    assert not x.contains(500_004.1)


def test_goals_must_lie_on_the_lines_of_the_moved_area(tmp_path: Path) -> None:
    data = PIONEER.sections()
    data["scene"]["area"] |= {"x": 4.0, "y": 2.5}
    data["scene"]["bays"] = list(data["scene"]["bays"])
    with pytest.raises(
        ValueError, match=r"two equal goals on the lines x = 0 and x = 8 at y = 2.5"
    ):
        SOCCER.equip(loaded(data, tmp_path))
