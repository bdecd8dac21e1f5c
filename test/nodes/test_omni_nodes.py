"""The nodes with omnidirectional robots."""

import math

import pytest
from chain_client import ChainClient, call
from conftest import Host, Start
from omni_robots import FILES
from ros_client import Client

from ator_interfaces.msg import Outcome
from ator_ros.geometry import Pose


@pytest.mark.long
@pytest.mark.parametrize("number", [0, 1], ids=[file.stem for file in FILES])
def test_an_omnidirectional_robot_drives_aside_while_it_turns(
    start: Start, host: Host, client: Client, number: int
) -> None:
    file = FILES[number]
    start("simulation", robot=file, real_time_factor=2.0)
    host("executor", robot=file, odom_timeout=5.0, start_timeout=60.0)
    begin = client.robot().pose
    assert begin == pytest.approx(Pose(-2.0, 0.0, 0.0), abs=1e-3)
    chains = ChainClient(client)
    aside = Pose(-2.0, 1.5, 0.0)
    turned = Pose(0.0, 1.5, math.pi / 2.0)
    outcome = chains.send([call("goToPose", aside), call("goToPose", turned)]).outcome()
    assert outcome.code == Outcome.SUCCEEDED, outcome.reason
    assert "slow" not in outcome.reason
    assert client.robot().pose == pytest.approx(turned, abs=0.12)
    lateral = [command.linear.y for command in chains.commands]
    assert max(lateral) > 0.3  # to the left, on the way to the first goal
    assert min(lateral) < -0.1  # to the right, while it drives along x and turns to look along y
