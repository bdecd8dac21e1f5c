"""Parameters of types that ROS does not know, for which rclpy raises."""

from __future__ import annotations

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
    wanted = [Parameter(name="seed", value=ParameterValue(type=99)), known]
    apart = client.call(
        SetParameters, "simulation/set_parameters", SetParameters.Request(parameters=wanted)
    ).results
    assert [result.successful for result in apart] == [False, True]
    assert apart[0].reason == "parameter 'seed': expected a type from 0 to 9, got 99"
    together = SetParametersAtomically.Request(parameters=wanted)
    name = "simulation/set_parameters_atomically"
    assert not client.call(SetParametersAtomically, name, together).result.successful
    together.parameters = [known]
    assert client.call(SetParametersAtomically, name, together).result.successful
    heard = len(client.robots)
    client.eventually(lambda: len(client.robots) > heard, "odometry")
    assert node.running
