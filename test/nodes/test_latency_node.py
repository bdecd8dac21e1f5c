"""The nodes with delayed states, over ROS."""

import math

import pytest
from chain_client import ChainClient, call, chain_of_the_paper
from conftest import Start
from ros_client import Client

from ator_interfaces.msg import Outcome
from ator_ros.geometry import Pose

LATENCY = 0.15
START, GOAL = Pose(-2.0, 0.0, 0.0), Pose(0.0, 0.0, 0.5)
SLOWLY = 2.0  # s that the simulation waits for commands on a busy machine


@pytest.mark.long
def test_a_compensated_latency_costs_little(start: Start, client: Client) -> None:
    """A drive to the ball is hardly slower, the ball stays, and the paper's chain succeeds."""
    start("simulation", real_time_factor=10.0, command_wait=SLOWLY, latency=LATENCY)
    start("refinement", deadline=5.0)
    start(
        "executor", start_timeout=60.0, odom_timeout=5.0, refinement_timeout=20.0, latency=LATENCY
    )
    chains = ChainClient(client)
    result = chains.send([call("goToBall", GOAL)]).result()
    assert result.outcome.code == Outcome.SUCCEEDED, result.outcome
    assert result.record.actual.duration < result.record.predicted.duration + 0.7
    ball = client.ball()
    assert math.hypot(ball.x, ball.y) < 0.02
    client.place(robot=START, ball=(0.0, 0.0))
    client.eventually(lambda: client.robot().pose.distance(START) < 0.02, "the robot at its place")
    outcome = chains.send(chain_of_the_paper(), refine=True).outcome()
    assert outcome.code == Outcome.SUCCEEDED, outcome
