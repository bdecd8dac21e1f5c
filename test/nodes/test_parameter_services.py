"""Changes of parameters while a node runs."""

from __future__ import annotations

import math

import pytest
from conftest import Start
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from ros_client import Client

pytestmark = pytest.mark.node


def test_limits_of_an_executor_change_and_nonsense_is_refused(start: Start, client: Client) -> None:
    node = start("executor")

    def change(name: str, **value: object) -> bool:
        kind = ParameterType.PARAMETER_STRING if "string_value" in value else ParameterType.PARAMETER_DOUBLE
        wanted = Parameter(name=name, value=ParameterValue(type=kind, **value))
        request = SetParameters.Request(parameters=[wanted])
        return bool(client.call(SetParameters, "executor/set_parameters", request).results[0].successful)

    for name in ("ball_timeout", "odom_timeout", "latency", "refine_again_after"):
        assert change(name, double_value=0.25), name
        for nonsense in (math.nan, math.inf, -1.0, 1e300):
            assert not change(name, double_value=nonsense), (name, nonsense)
        assert not change(name, string_value="soon"), name
    assert not change("ball_noise", double_value=0.1)  # fixed at the start
    assert node.running
