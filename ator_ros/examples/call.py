"""Call a service, send a goal to an action, or echo a topic, where the command `ros2` is not installed.

    python3 -m ator_ros.examples.call /reset std_srvs/srv/Trigger
    python3 -m ator_ros.examples.call /pause std_srvs/srv/SetBool "{data: true}"
    python3 -m ator_ros.examples.call /execute_chain ator_interfaces/action/ExecuteChain "{refine: true, ...}"
    python3 -m ator_ros.examples.call echo /performance/chain

The values are YAML; fields that are not named keep their defaults. Messages are printed one field per line.
Feedback of an action is printed as it comes, and Ctrl-C cancels the goal. The program needs rclpy, PyYAML and
the interfaces, and nothing else of ator_ros.
"""

from __future__ import annotations

import argparse
import array
import importlib
import json
import math
import re
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import rclpy
import yaml
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient, get_action_names_and_types
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rosidl_parser.definition import AbstractNestedType, NamespacedType

_PATIENCE = 10.0  # s
_LOOK = 0.1  # s after which Ctrl-C is noticed
_MOST_ITEMS = 24  # of a list that are printed
_ENDS = {GoalStatus.STATUS_CANCELED: "canceled"}


class CallError(ValueError):
    """A call that cannot be made; the message says what was expected and what came."""


def interface(name: str, places: Sequence[str] = ("srv", "action")) -> Any:
    """Import a type, such as std_srvs/srv/Trigger; `places` are among srv, action and msg."""
    try:
        package, place, kind = name.split("/")
        found = getattr(importlib.import_module(f"{package}.{place}"), kind)
        part = {"srv": "Request", "action": "Goal", "msg": "SLOT_TYPES"}[place]
        if place not in places or not hasattr(found, part):
            raise AttributeError(kind)
    except (ImportError, AttributeError, ValueError, TypeError, KeyError) as error:
        expected = " or ".join(f"PACKAGE/{place}/NAME" for place in places)
        raise CallError(f"type: expected an installed {expected}, got {name}") from error
    return found


def filled(message: Any, values: Any, where: str = "request") -> Any:
    """Write values, as YAML gives them, into the fields of a message, and return it."""
    if not isinstance(values, dict):
        raise CallError(f"{where}: expected fields with values, got {values!r}")
    kinds = dict(zip(message.get_fields_and_field_types(), message.SLOT_TYPES, strict=True))
    for name, value in values.items():
        if name not in kinds:
            raise CallError(f"{where}: expected fields among {', '.join(kinds)}, got {name!r}")
        setattr(message, name, _value(getattr(message, name), kinds[name], value, f"{where}.{name}"))
    return message


def _value(present: Any, kind: Any, value: Any, where: str) -> Any:
    """Return the value of a field, in the type that the field has."""
    if isinstance(kind, NamespacedType):
        return filled(present, value, where)
    if isinstance(kind, AbstractNestedType):
        if not isinstance(value, list):
            raise CallError(f"{where}: expected a list, got {value!r}")
        each = kind.value_type
        made = [_value(_new(each), each, item, f"{where}[{number}]") for number, item in enumerate(value)]
        return array.array(present.typecode, made) if isinstance(present, array.array) else made
    wanted = _plain(kind)
    if wanted is float and type(value) is int:
        return float(value)
    if type(value) is not wanted:
        raise CallError(f"{where}: expected a {wanted.__name__}, got {value!r}")
    if isinstance(value, int) and wanted is int:
        _check_range(kind.typename, int(value), where)
    return value


def _check_range(typename: str, value: int, where: str) -> None:
    """Refuse a whole number that a field of this type, such as int32 or uint8, cannot hold."""
    size = re.fullmatch(r"(u?)int(\d+)", typename)
    if size is None:
        return
    bits = int(size[2])
    low, high = (0, 2**bits - 1) if size[1] else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    if not low <= value <= high:
        raise CallError(f"{where}: expected {low} to {high}, got {value}")


def _new(kind: Any) -> Any:
    """Return a new item of a list of messages; None for other lists."""
    if not isinstance(kind, NamespacedType):
        return None
    return getattr(importlib.import_module(".".join(kind.namespaces)), kind.name)()


def _plain(kind: Any) -> type:
    """Return the Python type of a field that is no message and no list."""
    name = getattr(kind, "typename", "string")
    return {"boolean": bool, "float": float, "double": float, "string": str}.get(name, int)


def lines(message: Any, indent: str = "") -> Iterator[str]:
    """Yield the fields of a message, one per line, those of nested messages indented."""
    for name in message.get_fields_and_field_types():
        value = getattr(message, name)
        nested = value if isinstance(value, list) else [value]
        if not nested or not hasattr(nested[0], "get_fields_and_field_types"):
            yield f"{indent}{name}: {_text(value)}"
            continue
        for index, part in enumerate(nested):
            yield f"{indent}{name}[{index}]:" if isinstance(value, list) else f"{indent}{name}:"
            yield from lines(part, indent + "  ")


def _text(value: Any) -> str:
    """Return a number, a text or a list of them, floats with at most six digits."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, str):
        return value if value and value.isprintable() else json.dumps(value)
    if isinstance(value, int | bytes):
        return str(value)
    items = [_text(item) for item in (value.tolist() if hasattr(value, "tolist") else value)]
    more = [f"… {len(items)} in all"] if len(items) > _MOST_ITEMS else []
    return f"[{', '.join(items[:_MOST_ITEMS] + more)}]"


def show(message: Any, heading: str = "") -> None:
    """Print a message, beneath a heading if there is one."""
    indent = "  " if heading else ""
    print("\n".join([*([f"{heading}:"] if heading else []), *lines(message, indent)]), flush=True)


def echoed(node: Node, topic: str, kind: str, *, once: bool) -> None:
    """Print the messages of a topic until Ctrl-C, or the first one.

    Raises
    ------
    CallError
        The topic has no publisher, or its type is not installed.
    """
    try:
        name = node.resolve_topic_name(topic)
    except (NameValidationException, ValueError) as error:
        raise CallError(f"topic: expected a name such as /odom, got {topic!r}") from error
    end = time.monotonic() + _PATIENCE
    while not (publishers := node.get_publishers_info_by_topic(name)):
        if time.monotonic() > end:
            raise CallError(f"expected a publisher on {name} within {_PATIENCE:g} s, found none")
        time.sleep(_LOOK)
    offered = [each.qos_profile for each in publishers]
    latched = all(each.durability == DurabilityPolicy.TRANSIENT_LOCAL for each in offered)
    reliable = all(each.reliability == ReliabilityPolicy.RELIABLE for each in offered)
    profile = QoSProfile(
        depth=10,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
    )
    received: list[Any] = []
    message = interface(kind or publishers[0].topic_type, ("msg",))
    node.create_subscription(message, name, received.append, profile)
    while True:
        rclpy.spin_once(node, timeout_sec=_LOOK)
        for each in received:
            show(each)
            if once:
                return
            print("---", flush=True)
        received.clear()


def called(node: Node, service: str, kind: Any, request: Any) -> Any:
    """Call a service and return its response."""
    client = _client(node.create_client, "service", kind, service)
    if not client.wait_for_service(timeout_sec=_PATIENCE):
        types = dict(node.get_service_names_and_types()).get(node.resolve_service_name(service), [])
        raise CallError(
            f"expected the service {client.srv_name} within {_PATIENCE:g} s, {_found(types, kind)}"
        )
    return _answer(node, client.call_async(request), client.srv_name)


def performed(node: Node, action: str, kind: Any, goal: Any) -> Any:
    """Send a goal to an action, print its feedback, and return its result; Ctrl-C cancels the goal.

    Raises
    ------
    CallError
        There is no such action, or the goal did not succeed.
    """
    client = _client(partial(ActionClient, node), "action", kind, action)
    if not client.wait_for_server(timeout_sec=_PATIENCE):
        types = dict(get_action_names_and_types(node)).get(node.resolve_service_name(action), [])
        raise CallError(f"expected the action {action} within {_PATIENCE:g} s, {_found(types, kind)}")
    sent = client.send_goal_async(goal, feedback_callback=lambda message: show(message.feedback, "feedback"))
    try:
        ended = _end(node, sent, action, patience=math.inf)
    except KeyboardInterrupt:
        _answer(node, _accepted(node, sent, action).cancel_goal_async(), action)
        ended = _end(node, sent, action, patience=_PATIENCE)
    if ended.status != GoalStatus.STATUS_SUCCEEDED:
        show(ended.result, "result")
        raise CallError(f"{action}: the goal was {_ENDS.get(ended.status, 'aborted')}")
    return ended.result


def _accepted(node: Node, sent: Any, action: str) -> Any:
    """Return the handle of a goal that was sent."""
    handle = _answer(node, sent, action)
    if not handle.accepted:
        raise CallError(f"{action}: expected the goal to be accepted, it was rejected")
    return handle


def _end(node: Node, sent: Any, action: str, *, patience: float) -> Any:
    """Return status and result of a goal that was sent."""
    return _answer(node, _accepted(node, sent, action).get_result_async(), action, patience=patience)


def _client(create: Callable[[Any, str], Any], what: str, kind: Any, name: str) -> Any:
    try:
        return create(kind, name)
    except (NameValidationException, ValueError) as error:
        raise CallError(f"{what}: expected a name such as /reset, got {name!r}") from error


def _found(types: Sequence[str], kind: Any) -> str:
    """Return what there is of a name; among its types is the one that was asked for."""
    package, folder = kind.__module__.split(".")[:2]
    others = [name for name in types if name != f"{package}/{folder}/{kind.__name__}"]
    return f"found it with the type {', '.join(others)}" if others else "found none"


def _answer(node: Node, future: Any, name: str, *, patience: float = _PATIENCE) -> Any:
    """Wait for an answer in slices, between which Ctrl-C is noticed."""
    end = time.monotonic() + patience
    while not future.done() and time.monotonic() < end:
        rclpy.spin_until_future_complete(node, future, timeout_sec=_LOOK)
    if not future.done():
        raise CallError(f"{name}: expected an answer within {patience:g} s, got none")
    return future.result()


def main(words: list[str] | None = None) -> int:
    """Call the service, send the goal, or echo the topic, and print the messages; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="call", usage="call NAME TYPE [VALUES], or call echo TOPIC [TYPE] [--once]", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("name", help="of the service or action, such as /reset; echo: print a topic")
    parser.add_argument(
        "type", help="such as std_srvs/srv/Trigger or ator_interfaces/action/ExecuteChain; of echo the topic"
    )
    parser.add_argument(
        "values", nargs="?", default="",
        help="of the request's or goal's fields, as YAML; of echo the type, where several are published",
    )  # fmt: skip
    parser.add_argument("--once", action="store_true", help="of echo: end after one message")
    parser.add_argument(
        "-f", "--feedback", action="store_true", help="accepted as by `ros2`; feedback is always printed"
    )
    options = parser.parse_args(words)
    try:
        ask = _request(options)
    except (CallError, yaml.YAMLError) as error:
        print(f"call: {error}", file=sys.stderr)
        return 2
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # Ctrl-C shall cancel a goal, which needs ROS
    node = rclpy.create_node("call")
    try:
        ask(node)
    except CallError as error:
        print(f"call: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _request(options: argparse.Namespace) -> Callable[[Node], None]:
    """Return what the command line asks for, as a function of the node; raises CallError, YAMLError."""
    if options.name == "echo":
        return lambda node: echoed(node, options.type, options.values, once=options.once)
    kind = interface(options.type)
    values = yaml.safe_load(options.values or "{}")
    if hasattr(kind, "Goal"):
        goal = filled(kind.Goal(), values)
        return lambda node: show(performed(node, options.name, kind, goal), "result")
    request = filled(kind.Request(), values)
    return lambda node: show(called(node, options.name, kind, request))


if __name__ == "__main__":
    sys.exit(main())
