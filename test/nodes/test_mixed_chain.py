"""A chain of a remote action and a local action, in the simulation."""

from pathlib import Path

import pytest
from chain_client import ChainClient, call
from conftest import Start
from process import PATIENCE
from ros_client import Client

from ator_interfaces.msg import Outcome
from ator_ros.geometry import Pose

MIXED = Path(__file__).parents[1] / "mixed.yaml"


@pytest.mark.long
def test_remote_and_local_actions_mix(start: Start, client: Client) -> None:
    start("simulation", domain=MIXED, real_time_factor=1.0)
    start("drive_to_server")
    start("executor", domain=MIXED, odom_timeout=5.0, action_timeout=60.0)
    chains = ChainClient(client)
    services = ("place_robot", "execute_chain/_action/send_goal", "drive_to/_action/send_goal")
    ready = lambda: all(client.node.count_services(name) for name in services)  # noqa: E731
    client.eventually(ready, "three nodes", 4 * PATIENCE)
    client.place(robot=Pose(0.0, 0.0, 0.0))
    calls = [
        call("dock", Pose(0.6, 0.3, 0.5)),
        call("visit", Pose(1.2, 0.6, 0.8)),
        call("dock", Pose(0.8, 1.0, 3.0)),
    ]
    result = chains.send(calls).result(4 * PATIENCE)
    assert result.outcome.code == Outcome.SUCCEEDED, result.outcome.reason
    assert [record.action for record in result.record.actions] == ["goToPose", "drive", "goToPose"]
    for record in result.record.actions:
        assert record.outcome.code == Outcome.SUCCEEDED
        assert record.actual.duration > 0.0
        assert record.actual.accuracy < 0.25
