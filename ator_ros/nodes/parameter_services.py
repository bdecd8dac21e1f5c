"""Requests to change parameters that rclpy takes wrong.

It raises for types that it does not know, which would end the node, and takes one without a name as declared.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter

from ator_ros.printable import quoted

_TYPES = frozenset(kind.value for kind in Parameter.Type)

Callback = Callable[[Any, Any], Any]


def refuse_unknown_types(node: Node) -> None:
    """Have a node refuse parameters without a name, or of a type that ROS does not know.

    Parameters
    ----------
    node : Node
        With the services that rclpy gave it.
    """
    answers = {SetParameters: _one_by_one, SetParametersAtomically: _all_or_none}
    for service in node.services:
        if service.srv_type in answers:
            service.callback = functools.partial(answers[service.srv_type], service.callback)


def _one_by_one(callback: Callback, request: Any, response: Any) -> Any:
    """Answer for each parameter of a request on its own."""
    for item in request.parameters:
        refusal = _refusal(item)
        if refusal is None:
            one = SetParameters.Request(parameters=[item])
            response.results.extend(callback(one, SetParameters.Response()).results)
        else:
            response.results.append(refusal)
    return response


def _all_or_none(callback: Callback, request: Any, response: Any) -> Any:
    """Refuse all parameters of a request because of one."""
    refusals = (_refusal(item) for item in request.parameters)
    refusal = next((refusal for refusal in refusals if refusal is not None), None)
    if refusal is None:
        return callback(request, response)
    response.result = refusal
    return response


def _refusal(item: Any) -> SetParametersResult | None:
    """Return why a parameter of a request cannot be read; None if it can."""
    if not item.name:
        return SetParametersResult(successful=False, reason="expected the name of a parameter, got none")
    kind = item.value.type
    if kind in _TYPES:
        return None
    reason = f"parameter {quoted(item.name)}: expected a type from 0 to {max(_TYPES)}, got {kind}"
    return SetParametersResult(successful=False, reason=reason)
