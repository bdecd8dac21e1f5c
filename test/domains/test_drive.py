"""The domain `drive`: any robot with two driven wheels, without objects."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from maps import hall_map
from robots import PIONEER, PLAIN, SHIPPED, loaded

from ator_ros.actions.base import ActionError, Goal
from ator_ros.bases.description import Robot
from ator_ros.bases.differential.limits import Limits
from ator_ros.domains.domain import domain_for, find_domain
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.geometry import Pose
from ator_ros.tools import study
from ator_ros.tools.command_line import run_tool
from ator_ros.world.scene import Area, Scene
from ator_ros.world.state import RobotState, World

DRIVE = find_domain("drive")


def robot(limits: Limits, area: Area, size: float, **numbers: float) -> Robot:
    """Return a robot in an area without objects.

    `size` is the distance in m from the axle to all edges.
    """
    return dataclasses.replace(
        PLAIN,
        name="other",
        limits=limits,
        scene=Scene(area),
        front=size,
        rear=size,
        half_width=size,
        **numbers,
    )


TINY = robot(
    Limits(v=0.05, w=0.5, a=0.1, brake=0.1, aw=1.0),
    Area(2.0, 2.0, 0.5),
    0.05,
    wheel_radius=0.015,
    track=0.08,
    mass=0.3,
    wheel_torque=0.05,
)
LARGE = robot(
    Limits(v=5.0, w=1.5, a=2.0, brake=2.0, aw=3.0),
    Area(100.0, 60.0, 10.0, 5e5, 5e6),
    0.5,
    wheel_radius=0.2,
    track=0.6,
    mass=80.0,
    wheel_torque=60.0,
)
FAST = robot(
    Limits(v=15.0, w=1.0, a=3.0, brake=3.0, aw=2.0),
    Area(600.0, 400.0, 50.0),
    1.0,
    wheel_radius=0.3,
    track=1.2,
    mass=400.0,
    wheel_torque=400.0,
    grip=5.0,
)
ROBOTS = {"0.05 m/s": TINY, "0.46 m/s": DRIVE.robot(), "5 m/s": LARGE, "15 m/s": FAST}


@pytest.mark.parametrize("speed", ROBOTS)
def test_robots_of_all_speeds_pass_an_intermediate_place(speed: str, tmp_path: Path) -> None:
    described = DRIVE.equip(loaded(ROBOTS[speed].sections(), tmp_path))  # as declared in a file
    library = DRIVE.library(described)
    for seed in range(3):
        world, chain = DRIVE.chains["passing"](described, library, np.random.default_rng(seed))
        area = described.scene.area
        assert all(area.has_floor(call.goal.pose.x, call.goal.pose.y) for call in chain.calls)
        run = run_chain(described, library, world, chain, time_limit=DRIVE.time_limit)
        assert run.success, run.reason


def test_a_drive_through_a_wall_of_the_map_is_refused_before_the_robot_moves() -> None:
    mapped = DRIVE.on_map(hall_map())
    library = mapped.library(mapped.equip(PLAIN))
    action = library.action(library["goToPose"])
    world = World(0.0, RobotState(Pose(-2.0, 0.0, 0.0)))
    with pytest.raises(ActionError, match=r"got an obstacle of the map hall .* at \(-0\.\d+, 0\."):
        action.start(world, Goal(Pose(2.0, 0.5, 0.0)))
    action.start(world, Goal(Pose(-1.0, 0.5, 0.0)))
    through_the_door = World(0.0, RobotState(Pose(-2.0, 2.6, 0.0)))
    action.start(through_the_door, Goal(Pose(2.0, 2.6, 0.0)))


def test_soccer_needs_a_holder_and_a_ball(tmp_path: Path) -> None:
    assert domain_for("", None).name == "soccer"
    assert domain_for("", SHIPPED[0]).name == "drive"
    assert domain_for("soccer", SHIPPED[0]).name == "soccer"
    alone = PIONEER.sections()
    del alone["scene"]["objects"], alone["scene"]["bays"]
    loaded(alone, tmp_path)
    assert domain_for("", tmp_path / "own.yaml").name == "drive"


@pytest.mark.parametrize(
    ("words", "name"), [([], "soccer"), (["--robot", str(SHIPPED[0])], "drive")]
)
def test_tools_use_the_domain_of_the_robot(words: list[str], name: str) -> None:
    found: list[tuple[str, str]] = []
    run_tool(
        study.arguments(),
        lambda options, domain, _: found.append((options.domain, domain.name)),
        words,
    )
    assert found == [(name, name)]
