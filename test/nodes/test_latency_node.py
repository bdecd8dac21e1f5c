"""The nodes with delayed states, over ROS."""

from __future__ import annotations

import math

import pytest
from chain_client import ChainClient, call, chain_of_the_paper
from conftest import Start
from ros_client import Client

from ator_interfaces.msg import Outcome
from ator_ros.actions.base import Goal
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.field import BALL
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.geometry import Pose
from ator_ros.robot.description import load_robot
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.world.state import ObjectState, RobotState, World

LATENCY = 0.15
START, GOAL = Pose(-2.0, 0.0, 0.0), Pose(0.0, 0.0, 0.5)
SLOWLY = 2.0  # s that the simulation waits for commands on a busy machine


def duration_without_latency() -> float:
    """Return the duration in s of the drive without latency and without ROS."""
    robot = load_robot()
    library = SOCCER.library(robot)
    goal = Goal(GOAL, 0.0, library["goToBall"].point)
    chain = TopChain((TopCall(library["goToBall"], goal),))
    start = World(0.0, RobotState(START), {BALL: ObjectState(0.0, 0.0)})
    return run_chain(robot, library, start, chain).duration


@pytest.mark.long
def test_a_compensated_latency_costs_little(start: Start, client: Client) -> None:
    """A drive to the ball is hardly slower, the ball does not move, and the paper's chain succeeds."""
    start("simulation", real_time_factor=10.0, command_wait=SLOWLY, latency=LATENCY)
    start("refinement", deadline=5.0)
    start("executor", start_timeout=60.0, odom_timeout=5.0, refinement_timeout=20.0, latency=LATENCY)
    chains = ChainClient(client)
    result = chains.send([call("goToBall", GOAL)]).result()
    assert result.outcome.code == Outcome.SUCCEEDED, result.outcome
    assert result.record.actual.duration < duration_without_latency() + 0.5
    ball = client.ball()
    assert math.hypot(ball.x, ball.y) < 0.02
    client.place(robot=START, ball=(0.0, 0.0))
    client.eventually(lambda: client.robot().pose.distance(START) < 0.02, "the robot at its place")
    outcome = chains.send(chain_of_the_paper(), refine=True).outcome()
    assert outcome.code == Outcome.SUCCEEDED, outcome
