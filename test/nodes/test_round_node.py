"""The tool `round` with a running simulation and executor."""

from typing import Any

import pytest
from action_servers import Server
from arena import LONG_START
from conftest import Start
from process import executable, run
from rclpy.action.server import ServerGoalHandle
from ros_client import Client

from ator_ros.nodes.network import PROFILES
from ator_ros.tools.round_of_places import main

PASSING = ("--domain", "patrol", "--at", "-2", "0", "0", "--passing", "--execute")


class Executor(Server):
    """Ends each chain at once."""

    def notify_execute(self, goal_handle: ServerGoalHandle, execute_callback: Any) -> None:
        super().notify_execute(goal_handle, execute_callback)
        self.finish()


@pytest.mark.long
@pytest.mark.parametrize(
    ("words", "order", "passing"),
    [
        (("--return-home",), [0.0, 2.0, -2.0], [True, True, False]),
        (("--place", "4", "0"), [0.0, 2.0, 4.0], [False, True, False]),
    ],
)
def test_the_chain_of_a_round_passes_its_stations_up_to_its_end(
    client: Client,
    domain: int,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
    order: list[float],
    passing: list[bool],
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    monkeypatch.setenv(PROFILES, "")  # restored after the test, since the tool sets it
    server = client.within(lambda: Executor(client.node, "execute_chain"))
    assert main([*PASSING, *words, "--place", "2", "0", "--place", "0", "0"]) == 0
    calls = server.goals[0].request.chain.calls
    client.within(server.destroy)
    found = [call.goal.pose.position.x for call in calls]
    if words == ("--return-home",):  # the round may be driven either way round
        found = sorted(found[:2]) + found[2:]
    assert found == order
    # path times do not say what a stop takes: the last place as listed keeps its stop
    assert [call.passing for call in calls] == passing
    assert not any(call.open for call in calls)


WORDS = ("--domain", "drive", "--at", "-2", "0", "0", "--place", "1", "0", "--place", "-1", "0")


@pytest.mark.node
@pytest.mark.long
def test_the_round_is_driven_in_the_printed_order(
    start: Start, client: Client, domain: int
) -> None:
    without = run(executable("round"), *WORDS, "--execute", domain=domain)
    assert without.returncode == 1
    assert "execute_chain: expected its action server, got none; start the" in without.stderr
    start("simulation", domain="drive", real_time_factor=10.0, command_wait=0.5)
    executor = start("executor", domain="drive", odom_timeout=1.5)
    client.eventually(lambda: "ready for chains" in executor.output, "the executor", LONG_START)
    done = run(executable("round"), *WORDS, "--execute", domain=domain)
    assert done.returncode == 0, done.stdout + done.stderr
    _, first, second, _, driven = done.stdout.splitlines()
    assert [line.split()[0] for line in (first, second)] == ["2", "1"]
    assert driven.startswith("arrived")
    assert "s driven" in driven
    x, y, _ = client.robot().pose
    assert (x, y) == pytest.approx((1.0, 0.0), abs=0.1)
