"""The rate of simulated time in the `simulation` node, and its waiting for commands."""

import time

import pytest
from conftest import Host
from ros_client import Client
from selection import few


def test_the_real_time_factor_can_be_changed_at_runtime(host: Host, client: Client) -> None:
    host("simulation", real_time_factor=0.1)
    client.robot()
    before = client.robots[-1][0]
    assert not is_set(client, real_time_factor=-1.0)
    assert is_set(client, real_time_factor=20.0)
    assert not is_set(client, seed=5.0)
    client.eventually(lambda: client.robots[-1][0] > before + 5.0, "time goes on")


def test_as_fast_as_possible_waits_for_commands(host: Host, client: Client) -> None:
    host("simulation", real_time_factor=0.0, command_wait=0.5)
    assert is_set(client, command_wait=10.0)
    steer_a_little(client)
    # Earlier messages may still be in transit.
    client.eventually(lambda: is_silent(client), "the simulation waits", patience=9.0)


@pytest.mark.parametrize("factor", few([0.0, 1.5, 5.0], 0.0, 5.0))
def test_a_short_delay_of_commands_costs_only_its_duration(
    host: Host, client: Client, factor: float
) -> None:
    host("simulation", real_time_factor=factor, command_wait=0.05)
    steer_a_little(client)
    client.command(v=0.3)
    time.sleep(0.5)  # the command expires
    assert 0.7 < pace(client, 1.5) < 1.1


def pace(client: Client, seconds: float) -> float:
    """Return the simulated s per real s."""
    before, began = client.robots[-1][0], time.monotonic()
    time.sleep(seconds)
    return (client.robots[-1][0] - before) / (time.monotonic() - began)


def is_set(client: Client, **value: float) -> bool:
    """Set a parameter; return whether the node accepts it."""
    (result,) = client.set_parameters("simulation", **value)
    return bool(result.successful)


def steer_a_little(client: Client) -> None:
    """Send commands for some ticks, so that the simulation waits for commands."""
    client.robot()
    client.command(v=0.3)
    client.eventually(lambda: client.robot().vx > 0.0, "the robot starts")
    for _ in range(5):
        client.drive_a_tick(0.3)


def is_silent(client: Client) -> bool:
    """Return whether no tick is published within 0.5 s; without waiting there would be hundreds."""
    count = len(client.robots)
    time.sleep(0.5)
    return len(client.robots) == count
