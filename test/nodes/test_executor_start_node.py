"""The `executor` node started before its inputs: a goal waits for the first odometry and ball."""

import math
import signal

import pytest
from chain_client import PATROL, ChainClient, call, chain_of_the_paper
from conftest import Host, Start
from ros_client import Client
from selection import few

from ator_interfaces.msg import Outcome
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


@pytest.mark.parametrize("number", few([signal.SIGTERM, signal.SIGINT], signal.SIGTERM))
def test_shutdown_stops_the_robot_and_ends_cleanly(start: Start, host: Host, client: Client, number) -> None:
    host("simulation", real_time_factor=10.0, command_wait=0.5)
    executor = start("executor", odom_timeout=5.0, start_timeout=60.0)
    chains = ChainClient(client)
    client.robot()
    sent = chains.send(PATROL)
    chains.wait_until_moving()
    assert executor.stop(number) == 0
    assert "Traceback" not in executor.output
    # A client that is not discovered before the node ends may miss one of the two.
    client.eventually(lambda: sent.ended() or chains.chains, "news of the end")
    record = sent.result().record if sent.ended() else chains.chains[-1]
    assert record.outcome.code == Outcome.SHUTDOWN
    assert math.isnan(record.actual.success)
    client.eventually(lambda: chains.commands[-1].linear.x == 0.0, "a stop")
    client.eventually(chains.standing, "the robot stands")
