"""How fast the time of the node `simulation` goes, and for whom it waits."""

from __future__ import annotations

import time

import pytest
from conftest import Host
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from ros_client import Client

pytestmark = pytest.mark.node


def test_time_can_go_faster_while_it_runs(host: Host, client: Client) -> None:
    host("simulation", real_time_factor=0.1)
    client.robot()
    before = client.robots[-1][0]
    assert not set_factor(client, -1.0)
    assert set_factor(client, 20.0)
    assert not set_number(client, "seed", 5.0)
    client.eventually(lambda: client.robots[-1][0] > before + 5.0, "time goes on")


def test_as_fast_as_possible_waits_for_who_steers(host: Host, client: Client) -> None:
    host("simulation", real_time_factor=0.0, command_wait=0.5)
    assert set_number(client, "command_wait", 10.0)
    steer_a_little(client)
    # What was published before may still be on its way.
    client.eventually(lambda: is_silent(client), "the simulation waits", patience=9.0)


@pytest.mark.parametrize("factor", [0.0, 1.5, 5.0])
def test_who_is_held_up_for_a_moment_loses_that_moment_only(
    host: Host, client: Client, factor: float
) -> None:
    host("simulation", real_time_factor=factor, command_wait=0.05)
    steer_a_little(client)
    client.command(v=0.3)
    time.sleep(0.5)  # the command holds no longer
    assert 0.7 < pace(client, 1.5) < 1.1


def pace(client: Client, seconds: float) -> float:
    """Return how many simulated s pass in a real one."""
    before, began = client.robots[-1][0], time.monotonic()
    time.sleep(seconds)
    return (client.robots[-1][0] - before) / (time.monotonic() - began)


def set_factor(client: Client, factor: float) -> bool:
    """Let time go at another speed; return whether the node accepts that."""
    return set_number(client, "real_time_factor", factor)


def set_number(client: Client, name: str, number: float) -> bool:
    """Set a parameter; return whether the node accepts that."""
    value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=number)
    request = SetParameters.Request(parameters=[Parameter(name=name, value=value)])
    (result,) = client.call(SetParameters, "simulation/set_parameters", request).results
    return bool(result.successful)


def steer_a_little(client: Client) -> None:
    """Steer for some ticks, so that the simulation knows that somebody does."""
    client.robot()
    client.command(v=0.3)
    client.eventually(lambda: client.robot().v > 0.0, "the robot starts")
    for _ in range(5):
        client.drive_a_tick(0.3)


def is_silent(client: Client) -> bool:
    """Return whether no tick comes within half a second, in which hundreds would, were there no waiting."""
    heard = len(client.robots)
    time.sleep(0.5)
    return len(client.robots) == heard
