"""The executor sees how far the ball rolls, also without a goal."""

from __future__ import annotations

from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from process import Processes
from ros_client import Client

from ator_interfaces.srv import PlaceObject
from ator_ros.nodes.network import free_domain
from ator_ros.nodes.qos import RESULTS
from ator_ros.resources import resource_path

pytestmark = pytest.mark.node


def test_a_ball_that_rolls_farther_than_described_is_told(tmp_path: Path) -> None:
    described = resource_path("config", "pioneer.yaml").read_text(encoding="utf-8")
    slippery = described.replace("rolling_deceleration: 0.7", "rolling_deceleration: 0.35")
    assert slippery != described
    actual = tmp_path / "actual.yaml"
    actual.write_text(slippery, encoding="utf-8")
    with free_domain() as domain:
        processes, client = Processes(domain, tmp_path), Client(domain)
        try:
            processes.start("simulation", robot=str(actual))
            processes.start("executor")
            health = client.listen(DiagnosticArray, "/diagnostics", RESULTS)

            def told() -> str:
                values = {
                    value.key: value.value
                    for message in health
                    for status in message.status
                    if status.name == "/executor"
                    for value in status.values
                }
                return values.get("ball rolls", "") if values else "no word of the executor"

            client.eventually(lambda: health and not told(), "diagnostics of a robot as described")
            request = PlaceObject.Request()
            request.position.point.x, request.velocity.x = 1.0, 1.0
            assert client.call(PlaceObject, "place_ball", request).success
            client.eventually(told, "what the ball showed")
            assert told() == "slows down by 0.35 m/s^2, described as 0.7"
        finally:
            client.close()
            processes.kill()
