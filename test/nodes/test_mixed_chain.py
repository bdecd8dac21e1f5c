"""One chain of an action on somebody else's server and one of ours, in the simulation."""

from __future__ import annotations

from pathlib import Path

import pytest
from action_servers import Server
from chain_client import ChainClient, call
from conftest import Start
from process import PATIENCE
from ros_client import Client

from ator_interfaces.msg import Outcome
from ator_ros.geometry import Pose

DOMAIN = """
name: hall
tops:
  - name: visit
    action: drive
    post:
      - {variable: robot.x, target: goal.x, tolerance: 0.2}
      - {variable: robot.y, target: goal.y, tolerance: 0.2}
      - {variable: robot.yaw, target: goal.yaw, tolerance: 0.2}
  - name: dock
    action: goToPose
    post:
      - {variable: robot.x, target: goal.x, tolerance: 0.06}
      - {variable: robot.y, target: goal.y, tolerance: 0.06}
      - {variable: robot.yaw, target: goal.yaw, tolerance: 0.12}
actions:
  - name: drive
    remote:
      server: drive
      type: ator_interfaces/action/ExecuteChain
      goal: [{field: "chain.calls[0].goal", source: goal}]
      success: {fields: [{field: outcome.code, equals: 1}]}
      timeouts: {server: 10.0, acceptance: 10.0}
  - name: goToPose
    local: {domain: soccer}
"""


@pytest.mark.long
def test_actions_of_others_and_of_ours_mix(start: Start, client: Client, tmp_path: Path) -> None:
    file = tmp_path / "hall.yaml"
    file.write_text(DOMAIN, encoding="utf-8")
    start("simulation", domain=file, real_time_factor=1.0)
    start("executor", domain=file, odom_timeout=5.0, action_timeout=60.0)
    chains = ChainClient(client)
    services = ("place_robot", "execute_chain/_action/send_goal")
    ready = lambda: all(client.node.count_services(name) for name in services)  # noqa: E731
    client.eventually(ready, "both nodes", 4 * PATIENCE)
    client.place(robot=Pose(0.0, 0.0, 0.0))
    calls = [
        call("dock", Pose(0.6, 0.3, 0.5)),
        call("visit", Pose(1.2, 0.6, 0.8)),
        call("dock", Pose(0.8, 1.0, 3.0)),
    ]
    server = client.within(lambda: Server(client.node))
    sent = chains.send(calls)
    client.eventually(lambda: server.goals, "the second step", 4 * PATIENCE)
    client.place(robot=Pose(1.2, 0.6, 0.8))  # the server is somebody who moves the robot
    client.eventually(lambda: client.robot().pose.distance(Pose(1.2, 0.6, 0.8)) < 0.05, "odometry of it")
    client.within(server.finish)
    result = sent.result(4 * PATIENCE)
    assert result.outcome.code == Outcome.SUCCEEDED, result.outcome.reason
    assert [record.action for record in result.record.actions] == ["goToPose", "drive", "goToPose"]
    for record in result.record.actions:
        assert record.outcome.code == Outcome.SUCCEEDED
        assert record.actual.duration > 0.0
        assert record.actual.accuracy < 0.2
    assert len(server.goals) == 1
    client.within(server.destroy)
