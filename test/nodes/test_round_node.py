"""The tool `round` with a running simulation and executor."""

import pytest
from arena import LONG_START
from conftest import Start
from process import executable, run
from ros_client import Client

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
