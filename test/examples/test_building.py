"""The domain `building`: its tours, its planner, and simulated drives between walls."""

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from maps import hall, write_map

from ator_ros.actions.base import Goal, Status
from ator_ros.bases.routes import routes_of
from ator_ros.domains.domain import find_domain
from ator_ros.domains.trials import random_trial
from ator_ros.experience.simulated import episode_generator
from ator_ros.experience.table import read_experience
from ator_ros.geometry import Pose
from ator_ros.simulation.run import place, run_action
from ator_ros.simulation.scene_simulation import Simulation
from ator_ros.tools import collect
from ator_ros.world.state import Command, RobotState, World
from ator_ros_examples.navfn import NavFn
from ator_ros_examples.pursuit import Pursuit
from ator_ros_examples.rotate_drive_rotate import Phase, State
from ator_ros_examples.stand_ins import PursuitStandIn

DOMAIN = find_domain("building")
ROBOT = DOMAIN.robot()
GRID, ROUTES = ROBOT.grid, routes_of(ROBOT)
assert GRID is not None
assert ROUTES is not None
PLANNER = NavFn(GRID.free, GRID.resolution, GRID.origin, ROBOT.half_width)


def test_places_of_drives_and_tours_are_free_and_stations_in_different_rooms() -> None:
    library, spec = DOMAIN.library(ROBOT), DOMAIN.actions()["pursue"]
    ends = [spec.situation(ROBOT, episode_generator("pursue", 1, number)) for number in range(40)]
    pairs = [(each.robot.pose, each.goal.pose) for each in ends]
    for index in range(20):
        trial = random_trial(DOMAIN, "tour", library, seed=1, index=index)
        places = [trial.world.robot.pose, *(call.goal.pose for call in trial.chain.calls)]
        assert 4 <= len(trial.chain) <= 6
        steps = list(itertools.pairwise(places))
        assert all(PLANNER(here[:2], there[:2]) is not None for here, there in steps)
        pairs += steps
    x, y, to_x, to_y = np.array([(*here[:2], *there[:2]) for here, there in pairs]).T
    assert np.isfinite(ROUTES.between(x, y, to_x, to_y).length).all()
    with Simulation(ROBOT) as simulation:
        assert not any(simulation.robot_overlap(pose) for pair in pairs for pose in pair)


def test_walls_stop_the_robot() -> None:
    with Simulation(ROBOT) as simulation:
        assert simulation.robot_overlap(Pose(-3.05, 3.0, 0.0)) == "a wall"
        place(simulation, World(0.0, RobotState(Pose(-4.5, 3.0, 0.0))))
        for _ in range(100):
            simulation.command(Command(0.5, 0.0))
            simulation.tick()
        assert simulation.world().robot.pose.x == pytest.approx(-3.1 - ROBOT.front, abs=0.03)


def test_the_server_drives_through_doors_in_the_middle() -> None:
    start, goal = Pose(-7.0, 4.0, math.pi / 2), Pose(7.0, -4.8, 0.0)
    path = PLANNER(start[:2], goal[:2])
    assert path is not None
    length = np.hypot(*np.diff(path, axis=0).T).sum()
    shortest = ROUTES.between(*np.array([[*start[:2], *goal[:2]]]).T).length[0]
    assert shortest < length + 0.2 < 1.1 * shortest
    assert ROUTES.clearance(*path.T).min() > 0.25
    with Simulation(ROBOT) as simulation:
        place(simulation, World(0.0, RobotState(start)))
        done = run_action(simulation, PursuitStandIn(ROBOT), Goal(goal), time_limit=90.0)
        end = simulation.world().robot.pose
    assert done.status is Status.SUCCEEDED
    assert end.distance(goal) < 0.2


def test_paths_in_free_space_are_nearly_straight_and_none_leads_into_a_wall() -> None:
    path = NavFn(np.ones((100, 100), dtype=bool), 0.1, (-5.0, -5.0, 0.0), 0.2)(
        (-3.0, -2.0), (3.0, 1.0)
    )
    assert path is not None
    assert np.hypot(*np.diff(path, axis=0).T).sum() < 1.03 * math.hypot(6.0, 3.0)
    law = Pursuit((-3.05, 3.0, 0.0), PLANNER)
    assert law.step(State(0.0, -4.5, 3.0, 0.0)) == (0.0, 0.0)
    assert law.phase is Phase.MISSED


def test_drives_on_a_given_map_are_collected(tmp_path: Path) -> None:
    table = tmp_path / "table.parquet"
    words = ["--domain", "pursuit", "--map", str(write_map(tmp_path, hall())), "--episodes", "6"]
    assert collect.main([*words, "--jobs", "1", "--seed", "3", "--out", str(table)]) == 0
    read = read_experience(table)
    assert read.metadata["map"].startswith("hall.yaml (")
    assert read.frame["success"].all()
    starts = read.frame[read.frame["t"] == 0.0]
    around = starts[starts["x"] * starts["xg"] < 0.0]
    assert len(around)
    straight = np.hypot(around["x"] - around["xg"], around["y"] - around["yg"]) / 0.6
    assert (around["duration"] > straight).all()
