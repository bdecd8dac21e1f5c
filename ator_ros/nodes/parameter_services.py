"""Requests to change parameters that rclpy takes wrong, or refuses without saying why.

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

from ator_ros.nodes.parameters import FIXED
from ator_ros.printable import quoted

_TYPES = frozenset(kind.value for kind in Parameter.Type)

Callback = Callable[[Any, Any], Any]


def refuse_with_reasons(node: Node) -> None:
    """Have a node refuse, with a reason, what has no name, a type that ROS does not know, or is fixed.

    Parameters
    ----------
    node : Node
        With the services that rclpy gave it.
    """
    answers = {SetParameters: _one_by_one, SetParametersAtomically: _all_or_none}
    for service in node.services:
        if service.srv_type in answers:
            service.callback = functools.partial(answers[service.srv_type], node, service.callback)


def _one_by_one(node: Node, callback: Callback, request: Any, response: Any) -> Any:
    """Answer for each parameter of a request on its own."""
    for item in request.parameters:
        refusal = _refusal(node, item)
        if refusal is None:
            one = SetParameters.Request(parameters=[item])
            response.results.extend(callback(one, SetParameters.Response()).results)
        else:
            response.results.append(refusal)
    return response


def _all_or_none(node: Node, callback: Callback, request: Any, response: Any) -> Any:
    """Refuse all parameters of a request because of one."""
    refusals = (_refusal(node, item) for item in request.parameters)
    refusal = next((refusal for refusal in refusals if refusal is not None), None)
    if refusal is None:
        return callback(request, response)
    response.result = refusal
    return response


def _refusal(node: Node, item: Any) -> SetParametersResult | None:
    """Return why a parameter of a request cannot be set; None where rclpy can tell."""
    reason = _fault(node, item.name, item.value.type)
    return SetParametersResult(successful=False, reason=reason) if reason else None


def _fault(node: Node, name: str, kind: int) -> str:
    if not name:
        return "expected the name of a parameter, got none"
    if kind not in _TYPES:
        return f"parameter {quoted(name)}: expected a type from 0 to {max(_TYPES)}, got {kind}"
    if node.has_parameter(name) and FIXED in node.describe_parameter(name).additional_constraints:
        return f"parameter {name}: {FIXED}"
    return ""
