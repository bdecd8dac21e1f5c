"""The `executor` node started before its inputs: a goal waits for the first odometry and ball."""

from __future__ import annotations

import math

import pytest
from chain_client import ChainClient, call, chain_of_the_paper
from conftest import Host, Start
from ros_client import Client

from ator_interfaces.msg import Outcome
from ator_interfaces.srv import PlaceObject
from ator_ros.geometry import Pose

LONG = 60.0
"""Start time of a process on a loaded machine in real s."""
GENEROUS = {"start_timeout": LONG, "odom_timeout": 5.0}


# At factor 0 the simulation waits only after the first command; the goal's time limit may pass before.
@pytest.mark.long
@pytest.mark.parametrize("factor", [1.0, 4.0])
def test_a_goal_before_the_simulation_can_be_canceled_and_the_next_is_executed(
    start: Start, host: Host, client: Client, factor: float
) -> None:
    host("executor", **GENEROUS)
    chains = ChainClient(client)
    sent = chains.send([call("goToPose", Pose(1.0, 0.0, 0.0))])
    assert sent.cancel()
    result = sent.result()
    assert result.outcome.code == result.record.outcome.code == Outcome.CANCELED
    assert math.isnan(result.record.actual.success)
    sent, commands = chains.send(chain_of_the_paper()[:1]), len(chains.commands)
    client.eventually(lambda: sent.feedback or len(chains.commands) > commands, "a command to stand")
    start("simulation", real_time_factor=factor, command_wait=1.0)
    outcome = sent.result(LONG).outcome
    assert outcome.code == Outcome.SUCCEEDED, outcome.reason


def test_a_goal_waits_for_the_ball_at_rest(start: Start, host: Host, client: Client) -> None:
    start("simulation", real_time_factor=2.0)
    client.ball()
    assert client.call(PlaceObject, "place_ball", PlaceObject.Request(remove=True)).success
    host("executor", **GENEROUS)
    chains = ChainClient(client)
    sent = chains.send(chain_of_the_paper()[:1])
    client.eventually(lambda: len(chains.commands) > 5, "commands")
    assert all(command.linear.x == command.angular.z == 0.0 for command in chains.commands)
    client.place(ball=(0.0, 0.0))
    outcome = sent.result(LONG).outcome
    assert outcome.code == Outcome.SUCCEEDED, outcome.reason
