"""Call a service as `ros2 service call` does, where that command is not installed.

    python3 -m ator_ros.examples.call /reset std_srvs/srv/Trigger
    python3 -m ator_ros.examples.call /pause std_srvs/srv/SetBool "{data: true}"

The values are YAML; fields that are not named keep their defaults. The program needs rclpy, PyYAML and the
interfaces, and nothing else of ator_ros.
"""

from __future__ import annotations

import argparse
import array
import importlib
import re
import sys
from typing import Any

import rclpy
import yaml
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rosidl_parser.definition import AbstractNestedType, NamespacedType

_PATIENCE = 10.0  # s


class CallError(ValueError):
    """A call that cannot be made; the message says what was expected and what came."""


def service_type(name: str) -> Any:
    """Import a service type, such as std_srvs/srv/Trigger."""
    package, _, kind = name.partition("/srv/")
    try:
        return getattr(importlib.import_module(f"{package}.srv"), kind)
    except (ImportError, AttributeError, ValueError) as error:
        raise CallError(f"type: expected an installed PACKAGE/srv/NAME, got {name}") from error


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


def called(node: Node, service: str, kind: Any, request: Any) -> Any:
    """Call a service and return its response."""
    try:
        client = node.create_client(kind, service)
    except NameValidationException as error:
        raise CallError(f"service: expected a name such as /reset, got {service!r}") from error
    if not client.wait_for_service(timeout_sec=_PATIENCE):
        others = dict(node.get_service_names_and_types()).get(node.resolve_service_name(service), [])
        found = f"found it with the type {', '.join(others)}" if others else "found none"
        raise CallError(f"expected the service {client.srv_name} within {_PATIENCE:g} s, {found}")
    future = client.call_async(request)
    rclpy.spin_until_future_complete(node, future, timeout_sec=_PATIENCE)
    if not future.done():
        raise CallError(f"{client.srv_name}: expected an answer within {_PATIENCE:g} s, got none")
    return future.result()


def main(words: list[str] | None = None) -> int:
    """Call the service and print its response; return the exit code."""
    parser = argparse.ArgumentParser(prog="call", description="Call a service, as `ros2 service call` does.")
    parser.add_argument("service", help="its name, such as /reset")
    parser.add_argument("type", help="such as std_srvs/srv/Trigger")
    parser.add_argument("values", nargs="?", default="{}", help="of the request's fields, as YAML")
    options = parser.parse_args(words)
    try:
        kind = service_type(options.type)
        request = filled(kind.Request(), yaml.safe_load(options.values))
    except (CallError, yaml.YAMLError) as error:
        print(f"call: {error}", file=sys.stderr)
        return 2
    rclpy.init()
    node = rclpy.create_node("call")
    try:
        print(called(node, options.service, kind, request))
    except CallError as error:
        print(f"call: {error}", file=sys.stderr)
        return 1
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
