"""The `executor` node is shut down while the robot drives."""

import math
import signal

import pytest
from chain_client import PATROL, ChainClient
from conftest import Host, Start
from ros_client import Client
from selection import few

from ator_interfaces.msg import Outcome


@pytest.mark.parametrize("number", few([signal.SIGTERM, signal.SIGINT], signal.SIGTERM))
def test_shutdown_stops_the_robot_and_ends_cleanly(
    start: Start, host: Host, client: Client, number
) -> None:
    host("simulation", real_time_factor=10.0, command_wait=0.5)
    executor = start("executor", odom_timeout=5.0, start_timeout=60.0)
    chains = ChainClient(client)
    client.robot()
    sent = chains.send(PATROL)
    chains.wait_until_moving()
    assert executor.stop(number) == 0
    assert "Traceback" not in executor.output
    # A client that is not discovered before the node ends may miss one of the two.
    client.eventually(lambda: sent.ended() or chains.chains, "the goal's end")
    record = sent.result().record if sent.ended() else chains.chains[-1]
    assert record.outcome.code == Outcome.SHUTDOWN
    assert math.isnan(record.actual.success)
    client.eventually(lambda: chains.commands[-1].linear.x == 0.0, "a stop")
    client.eventually(chains.standing, "the robot stands")
