"""Parameters that rclpy takes wrong: of types that ROS does not know, and without a name."""

from __future__ import annotations

import math

import pytest
from conftest import Start
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from ros_client import Client

pytestmark = pytest.mark.node


def test_a_parameter_of_an_unknown_type_is_refused_and_the_node_goes_on(start: Start, client: Client) -> None:
    node = start("simulation", real_time_factor=2.0)
    client.robot()
    number = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=3.0)
    known = Parameter(name="real_time_factor", value=number)
    wanted = [Parameter(name="seed", value=ParameterValue(type=99)), Parameter(value=number), known]
    apart = client.call(
        SetParameters, "simulation/set_parameters", SetParameters.Request(parameters=wanted)
    ).results
    assert [result.successful for result in apart] == [False, False, True]
    assert apart[0].reason == "parameter 'seed': expected a type from 0 to 9, got 99"
    assert apart[1].reason == "expected the name of a parameter, got none"
    fixed = SetParameters.Request(parameters=[Parameter(name="seed", value=number)])
    reason = client.call(SetParameters, "simulation/set_parameters", fixed).results[0].reason
    assert reason.startswith("parameter seed: fixed at the start, when topics, world and models are made")
    together = SetParametersAtomically.Request(parameters=wanted)
    name = "simulation/set_parameters_atomically"
    assert not client.call(SetParametersAtomically, name, together).result.successful
    together.parameters = [known]
    assert client.call(SetParametersAtomically, name, together).result.successful
    heard = len(client.robots)
    client.eventually(lambda: len(client.robots) > heard, "odometry")
    assert node.running


def test_limits_of_an_executor_change_and_nonsense_is_refused(start: Start, client: Client) -> None:
    node = start("executor")

    def change(name: str, **value: object) -> bool:
        kind = ParameterType.PARAMETER_STRING if "string_value" in value else ParameterType.PARAMETER_DOUBLE
        wanted = Parameter(name=name, value=ParameterValue(type=kind, **value))
        request = SetParameters.Request(parameters=[wanted])
        return bool(client.call(SetParameters, "executor/set_parameters", request).results[0].successful)

    for name in ("ball_timeout", "odom_timeout", "plan_timeout", "latency", "refine_again_after"):
        assert change(name, double_value=0.25), name
        for nonsense in (math.nan, math.inf, -1.0, 1e300):
            assert not change(name, double_value=nonsense), (name, nonsense)
        assert not change(name, string_value="soon"), name
    assert not change("ball_noise", double_value=0.1)  # fixed at the start
    assert node.running
