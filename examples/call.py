"""Call a service, send a goal to an action, or echo a topic, without the command `ros2`.

    python3 examples/call.py /reset std_srvs/srv/Trigger
    python3 examples/call.py /pause std_srvs/srv/SetBool "{data: true}"
    python3 examples/call.py /execute_chain ator_interfaces/action/ExecuteChain "{refine: true}"
    python3 examples/call.py echo /performance/chain

The values are YAML; other fields keep their defaults. --feedback prints a line when a text or an
integer in a goal's feedback changes. Before a result, its reason is printed in a line of its own.
Ctrl-C cancels the goal. The program needs rclpy, PyYAML, ator_ros and the packages of the types.
"""

from __future__ import annotations

import argparse
import importlib
import math
import re
import signal
import sys
import time
from collections.abc import Callable
from typing import Any

import rclpy
import yaml
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions

from ator_ros.nodes.leases import publish_lease

_TIMEOUT = 10.0  # s
_START_TIMEOUT = 60.0  # s: nodes that start compile code before they offer services and actions
_WAIT_REPORTED_AFTER = 5.0  # s
_POLL = 0.1  # s: Ctrl-C is handled between two waits


class CallError(Exception):
    """A call is impossible or has failed; the message is one line: expected, actual."""


def interface(name: str) -> Any:
    """Return the class of a type such as std_srvs/srv/Trigger."""
    try:
        package, folder, kind = name.split("/")
        return getattr(importlib.import_module(f"{package}.{folder}"), kind)
    except (ImportError, AttributeError, ValueError) as error:
        raise CallError(
            f"type: expected an installed one, such as std_srvs/srv/Trigger, got {name}"
        ) from error


def filled(kind: Any, values: Any, where: str = "request") -> Any:
    """Return a message of a class with parsed YAML values in its fields."""
    if not isinstance(values, dict):
        raise CallError(f"{where}: expected fields with values, got {values!r}")
    message, types = kind(check_fields=True), kind.get_fields_and_field_types()
    for name, value in values.items():
        place = f"{where}.{name}"
        if name not in types:
            raise CallError(f"{where}: expected fields among {', '.join(types)}, got {name!r}")
        if found := re.search(r"(\w+)/(\w+)", types[name]):
            nested = interface(f"{found[1]}/msg/{found[2]}")
            if "<" in types[name] and isinstance(value, list):
                value = [
                    filled(nested, item, f"{place}[{index}]") for index, item in enumerate(value)
                ]
            elif "<" not in types[name]:
                value = filled(nested, value, place)
        elif "double" in types[name] or "float" in types[name]:
            value = _floats(value)
        try:
            setattr(message, name, value)
        except (AssertionError, TypeError, OverflowError) as error:
            raise CallError(f"{place}: expected {types[name]}, got {value!r}") from error
    return message


def _floats(value: Any) -> Any:
    """Return integers as floats, also in lists."""
    if isinstance(value, list):
        return [_floats(item) for item in value]
    return float(value) if type(value) is int else value


def show(message: Any, end: str = "") -> None:
    """Print a message, or messages by name, as YAML, with at most six digits of each number."""
    print(
        yaml.safe_dump(_plain(message), sort_keys=False, width=1000, allow_unicode=True),
        end=end,
        flush=True,
    )


class FeedbackLines:
    """Prints feedback in a line each time that anything but its floats changes."""

    def __init__(self) -> None:
        self._last: Any = None

    def show(self, message: Any) -> None:
        """Print the feedback of a message of an action if it is new."""
        fields = _plain(message.feedback)
        state = _without_floats(fields)
        if state == self._last:
            return
        self._last = state
        text = yaml.safe_dump(
            fields, sort_keys=False, width=math.inf, allow_unicode=True, default_flow_style=True
        )
        print(f"feedback: {text.strip()}", flush=True)


def _without_floats(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _without_floats(item) for name, item in value.items()}
    if isinstance(value, list):
        return [_without_floats(item) for item in value]
    return None if isinstance(value, float) else value


def reason_of(result: Any) -> str:
    """Return the reason in a result, such as that of execute_chain, in one line, or ""."""
    reason = getattr(getattr(result, "outcome", None), "reason", "")
    return " ".join(str(reason).split())


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    if hasattr(value, "get_fields_and_field_types"):
        return {name: _plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, str | bool | int):
        return value
    if isinstance(value, bytes):  # a field of type byte
        return value[0]
    if hasattr(value, "tolist"):  # arrays of numbers
        return _plain(value.tolist())
    if isinstance(value, float):
        return float(f"{value:.6g}")
    return [_plain(item) for item in value]


def echo(node: Node, topic: str, *, once: bool) -> None:
    """Print the messages of a topic until Ctrl-C, or the first one only."""
    name, end = node.resolve_topic_name(topic), time.monotonic() + _TIMEOUT
    while not (publishers := node.get_publishers_info_by_topic(name)):
        if time.monotonic() > end:
            raise CallError(f"expected a publisher on {name} within {_TIMEOUT:g} s, found none")
        time.sleep(_POLL)
    offered, received = publishers[0].qos_profile, list[Any]()
    profile = QoSProfile(depth=10, durability=offered.durability, reliability=offered.reliability)
    node.create_subscription(interface(publishers[0].topic_type), name, received.append, profile)
    while not (once and received):
        rclpy.spin_once(node, timeout_sec=_POLL)
        while received and not once:
            show(received.pop(0), "---\n")
    show(received[0])


def _wait_for(wait: Callable[..., bool], what: str, name: str) -> None:
    """Wait for a service or an action; `wait` is the method of its client that waits."""
    if wait(timeout_sec=_WAIT_REPORTED_AFTER):
        return
    print(f"waiting for {name}; nodes that start compile code", file=sys.stderr, flush=True)
    if not wait(timeout_sec=_START_TIMEOUT - _WAIT_REPORTED_AFTER):
        raise CallError(f"expected {what} of this type within {_START_TIMEOUT:g} s, found none")


def call(node: Node, service: str, kind: Any, values: Any) -> None:
    """Call a service and print its response."""
    client = node.create_client(kind, service)
    _wait_for(client.wait_for_service, f"the service {service}", service)
    show(_answer(node, client.call_async(filled(kind.Request, values)), service))


def send_goal(node: Node, action: str, kind: Any, values: Any, *, feedback: bool) -> None:
    """Send a goal to an action, and print its result and, if requested, feedback.

    Ctrl-C cancels it.
    """
    client = ActionClient(node, kind, action)
    _wait_for(client.wait_for_server, f"the action {action}", action)
    goal = filled(kind.Goal, values, "goal")
    if hasattr(goal, "lease") and not goal.lease:
        goal.lease = publish_lease(node)  # a chain of execute_chain ends with this program
    sent = client.send_goal_async(
        goal,
        feedback_callback=FeedbackLines().show if feedback else None,
    )
    handle = _answer(node, sent, action)
    if not handle.accepted:
        raise CallError(f"{action}: expected the goal to be accepted, it was rejected")
    result = handle.get_result_async()
    try:
        ended = _answer(node, result, action, timeout=math.inf)
    except KeyboardInterrupt:
        _answer(node, handle.cancel_goal_async(), action)
        ended = _answer(node, result, action)
    if reason := reason_of(ended.result):
        print(reason)
    show({"result": ended.result})
    if ended.status != GoalStatus.STATUS_SUCCEEDED:
        how = "canceled" if ended.status == GoalStatus.STATUS_CANCELED else "aborted"
        raise CallError(f"{action}: the goal was {how}")


def _answer(node: Node, future: Any, name: str, *, timeout: float = _TIMEOUT) -> Any:
    end = time.monotonic() + timeout
    while not future.done() and time.monotonic() < end:
        rclpy.spin_until_future_complete(node, future, timeout_sec=_POLL)
    if not future.done():
        raise CallError(f"{name}: expected an answer within {timeout:g} s, got none")
    return future.result()


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="call", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("name", help="of the service or action, such as /reset; or echo")
    parser.add_argument("type", help="such as std_srvs/srv/Trigger; echo: the topic")
    parser.add_argument(
        "values", nargs="?", default="{}", help="of the request's or goal's fields, as YAML"
    )
    parser.add_argument("--once", action="store_true", help="echo: end after one message")
    parser.add_argument(
        "-f", "--feedback", action="store_true", help="print the feedback of a goal"
    )
    options = parser.parse_args(arguments)
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # Ctrl-C first cancels the goal
    node = rclpy.create_node("call")
    try:
        if options.name == "echo":
            echo(node, options.type, once=options.once)
        else:
            kind, values = interface(options.type), yaml.safe_load(options.values)
            if hasattr(kind, "Goal"):
                send_goal(node, options.name, kind, values, feedback=options.feedback)
            else:
                call(node, options.name, kind, values)
    except (CallError, yaml.YAMLError, NameValidationException) as error:
        print(f"call: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # end where a reader such as head has ended
    sys.exit(main())
