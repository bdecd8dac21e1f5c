"""Robots other than the Pioneer: shipped descriptions, actions and simulation."""

import math
from pathlib import Path

import pytest
from robots import FIFTH, HEAVY, PIONEER, PLAIN, QUICK, SHIPPED

from ator_ros.bases.description import Robot, load_robot
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.domains.trials import random_trial, with_headings
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.geometry import Pose
from ator_ros.nodes.parameters import domain_and_robot
from ator_ros.simulation.run import place
from ator_ros.simulation.scene_simulation import CONTROL_RATE, Simulation
from ator_ros.world.state import Command, RobotState, World


@pytest.mark.parametrize(
    "robot", [PIONEER, PLAIN, HEAVY, QUICK, FIFTH], ids=lambda robot: robot.name
)
def test_the_simulated_base_has_the_described_lag(robot: Robot) -> None:
    gain, ticks = 0.9 * robot.limits.a, 10
    assert gain * ticks / CONTROL_RATE < robot.limits.v
    with Simulation(robot) as simulation:
        place(simulation, World(0.0, RobotState(Pose(0.0, 0.0, 0.0)), {}))
        for tick in range(1, ticks + 1):
            simulation.command(Command(gain * tick / CONTROL_RATE, 0.0))
            simulation.tick()
        behind = ticks / CONTROL_RATE - simulation.world().robot.vx / gain
    assert behind == pytest.approx(robot.motor_time_constant, abs=0.015)


@pytest.mark.parametrize("file", SHIPPED, ids=lambda file: file.stem)
def test_nodes_load_each_file_and_a_naive_chain_succeeds(file: Path) -> None:
    _, robot = domain_and_robot({"domain": "soccer", "robot": str(file)})
    assert robot == load_robot(file)
    library = SOCCER.library(robot)
    trial = random_trial(SOCCER, "dribble" if robot.holder else "drive", library, seed=3, index=0)
    start, first = trial.world.robot.pose, trial.chain.calls[0].goal.pose
    chain = with_headings(trial.chain, {0: math.atan2(first.y - start.y, first.x - start.x)})
    done = run_chain(robot, library, trial.world, chain)
    assert done.success, done.reason
