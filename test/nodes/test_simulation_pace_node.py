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
    wanted = [("real_time_factor", 20.0, True), ("real_time_factor", -1.0, False), ("seed", 5.0, False)]
    for name, value, is_taken in wanted:
        number = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value)
        request = SetParameters.Request(parameters=[Parameter(name=name, value=number)])
        (result,) = client.call(SetParameters, "simulation/set_parameters", request).results
        assert result.successful == is_taken, result.reason
    client.eventually(lambda: client.robots[-1][0] > before + 5.0, "time goes on")


def test_as_fast_as_possible_waits_for_who_steers(host: Host, client: Client) -> None:
    host("simulation", real_time_factor=0.0, command_wait=10.0)
    steer_a_little(client)
    # What was published before may still be on its way.
    client.eventually(lambda: is_silent(client), "the simulation waits", patience=9.0)


def test_it_waits_again_for_who_is_late_once(host: Host, client: Client) -> None:
    """As where one program hands over to another; else hundreds of ticks pass until that one begins."""
    host("simulation", real_time_factor=0.0, command_wait=0.5)
    steer_a_little(client)
    time.sleep(0.1)  # what was published before may still be on its way
    heard = len(client.robots)
    time.sleep(0.8)
    assert 1 <= len(client.robots) - heard <= 2


def test_who_is_held_up_for_a_moment_loses_that_moment_only(host: Host, client: Client) -> None:
    host("simulation", real_time_factor=0.0, command_wait=0.05)
    steer_a_little(client)
    before, began = client.robots[-1][0], time.monotonic()
    time.sleep(1.5)
    passed = client.robots[-1][0] - before
    assert 0.3 < passed < time.monotonic() - began + 1.0  # unhurried; else it would be a minute
    client.eventually(lambda: client.robots[-1][0] > before + 30.0, "nobody steers any more", patience=15.0)


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
