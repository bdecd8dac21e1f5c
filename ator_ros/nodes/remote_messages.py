"""Goals of any action type: found at run time, and filled by the paths of their fields."""

from __future__ import annotations

import importlib
import re
from functools import partial
from typing import Any

from geometry_msgs.msg import PoseStamped

from ator_ros.actions.base import Goal
from ator_ros.actions.goal_variables import goal_values
from ator_ros.actions.remote import Filling, RemoteCall, parts
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of
from ator_ros.printable import printable, quoted

_FLOATS = ("float", "double", "long double")


class RemoteError(ValueError):
    """An action server that cannot be used as declared; the message says what was expected and what came."""


def action_type_of(name: str) -> Any:
    """Import an action type, as nav2_msgs/action/NavigateToPose; raises RemoteError."""
    package, folder, kind = name.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.{folder}"), kind)
    except ImportError as error:
        raise RemoteError(
            f"type: expected {name} to be installed, as by `apt install "
            f"ros-jazzy-{package.replace('_', '-')}`, or sourced: {printable(str(error), 200)}"
        ) from error
    except AttributeError as error:
        raise RemoteError(f"type: expected an action of {package}, got {quoted(kind)}") from error


class GoalWriter:
    """Writes the goals of a server, whose message is of the type `kind`; states are in the frame `frame`.

    Raises RemoteError if the message lacks a field, or a field cannot hold what is to be written.
    """

    def __init__(self, call: RemoteCall, kind: Any, frame: str) -> None:
        self._call, self._kind, self._frame = call, kind, frame
        names = [filling.goal_variable for filling in call.goal]
        self.written(Goal(Pose(0.0, 0.0, 0.0), values={name: 0.0 for name in names if name}))

    def written(self, goal: Goal) -> Any:
        """Return the message for `goal`."""
        fields: dict[str, Any] = {}
        for filling in self._call.goal:
            *path, (last, indexed) = parts(filling.field)
            inner = fields
            for name, listed in path:
                item = inner.setdefault(name, [{}] if listed else {})
                inner = item[0] if isinstance(item, list) else item
            value = partial(_value, filling, goal, self._frame)
            inner[last] = [value] if indexed else value
        return _message(self._kind, fields, "goal")


def _value(filling: Filling, goal: Goal, frame: str, kind: str) -> Any:
    """Return what fills a field of this type."""
    if filling.source is None:
        constant = filling.constant
        return float(constant) if isinstance(constant, int) and kind in _FLOATS else constant
    if filling.source == "frame":
        return frame
    if filling.source != "goal":
        return float(goal_values(goal)[str(filling.goal_variable)])
    if not kind.endswith("/PoseStamped"):
        return pose_of(goal.pose)
    stamped = PoseStamped(pose=pose_of(goal.pose))
    stamped.header.frame_id = filling.frame or frame
    return stamped


def _message(kind: Any, fields: dict[str, Any], where: str) -> Any:
    """Make a message of `fields`: functions of their type, or fields of an inner message; lists have one."""
    values = {}
    for name, given in fields.items():
        inner = _type_of(kind, name, isinstance(given, list), where)
        item = given[0] if isinstance(given, list) else given
        made = item(inner) if callable(item) else _message(_class_of(inner), item, f"{where}.{name}")
        values[name] = [made] if isinstance(given, list) else made
    try:
        return kind(check_fields=True, **values)
    except AssertionError as error:  # its own words: which type the field has
        raise RemoteError(f"{where}: {' '.join(str(error).split())}") from error


def _type_of(kind: Any, name: str, indexed: bool, where: str) -> str:
    """Return the type of a field, or if `indexed` that of its items; raises RemoteError."""
    known = {} if kind is None else kind.get_fields_and_field_types()
    if name not in known:
        raise RemoteError(f"{where}: expected one of {', '.join(known) or 'no fields'}, got {quoted(name)}")
    found = str(known[name])
    items = re.fullmatch(r"sequence<([^,>]+).*>", found)
    if indexed != (items is not None) and (indexed or "/" in found):
        raise RemoteError(f"{where}: expected {name}{'' if indexed else '[0]'}, as it is of the type {found}")
    return items[1] if indexed and items is not None else found


def _class_of(kind: str) -> Any:
    """Return the class of a message; None for what is no message."""
    package, _, name = kind.partition("/")
    return getattr(importlib.import_module(f"{package}.msg"), name) if name else None


def check_result(call: RemoteCall, kind: Any) -> None:
    """Make sure that the result's message has the fields that are read; raises RemoteError."""
    paths = [expected.field for expected in call.success.fields]
    for path in (*paths, *filter(None, [call.success.reason])):
        message = kind
        for name, indexed in parts(path):
            message = _class_of(_type_of(message, name, indexed, f"success: {path}"))


def interface_of(call: RemoteCall, frame: str) -> tuple[Any, GoalWriter]:
    """Return the action type of a server, and what writes its goals in `frame`.

    Raises
    ------
    RemoteError
        The type is not installed, or has no such field.
    """
    kind: Any = action_type_of(call.type)
    writer = GoalWriter(call, kind.Goal, frame)
    check_result(call, kind.Result)
    return kind, writer
