"""A newer goal while another one is under way, or while the executor ends."""

from __future__ import annotations

import time

import pytest
from chain_client import ChainClient, call
from conftest import Host
from hall import Base
from hosted import Hosted
from ros_client import Client

from ator_interfaces.msg import Outcome
from ator_ros.geometry import Pose


@pytest.fixture
def hosted(host: Host) -> Hosted:
    return host("executor", odom_timeout=2.0)


@pytest.mark.usefixtures("hosted")
def test_after_a_preemption_silence_is_noticed_as_soon_as_before(client: Client) -> None:
    base, chains = Base(client), ChainClient(client)
    chains.send([call("goToPose", Pose(1.0, 0.0, 0.0))])
    time.sleep(0.1)
    newer = chains.send([call("goToPose", Pose(1.0, 0.5, 0.0))])
    before = len(chains.commands)
    client.eventually(lambda: len(chains.commands) > before + 5, "commands for the newer one")
    base.close()
    before = len(chains.commands)
    assert newer.outcome().code == Outcome.INPUT_LOST
    stops = chains.commands[before:]
    assert len(stops) > 10  # one every 0.05 s, where it is watched closely


def test_a_goal_that_comes_while_the_node_ends_is_rejected(hosted: Hosted, client: Client) -> None:
    base, chains = Base(client), ChainClient(client)
    client.robot()
    hosted.node._stopping = True  # as `stop` does first
    with pytest.raises(AssertionError):
        chains.send([call("goToPose", Pose(1.0, 0.0, 0.0))])
    assert not chains.commands
    base.close()
