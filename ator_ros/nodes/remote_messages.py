"""Goals of any action type: found at run time, and filled by the paths of their fields."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped
from rosidl_parser import definition

from ator_ros.actions.base import Goal
from ator_ros.actions.goal_variables import goal_values
from ator_ros.actions.remote import Filling, RemoteCall, parts
from ator_ros.nodes.messages import pose_of
from ator_ros.printable import printable, quoted

_FLOATS = ("float", "double", "long double")
_POSES = ("Pose", "PoseStamped")


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
        self._kind = kind
        self._writers = [
            (filling.field, _writer(filling, kind, frame, f"goal[{number}]"))
            for number, filling in enumerate(call.goal)
        ]

    def written(self, goal: Goal) -> Any:
        """Return the message for `goal`."""
        message = self._kind()
        for path, value in self._writers:
            _put(message, path, value(goal))
        return message


def _writer(filling: Filling, kind: Any, frame: str, where: str) -> Callable[[Goal], Any]:
    """Return what computes the value of a field from a goal."""
    slot, source = _slot(kind, filling.field, where), filling.source
    if source is None:
        constant = _fitting(filling.constant, slot, where)
        return lambda _: constant
    if source == "goal":
        name = getattr(slot, "name", "")
        _require(name in _POSES, where, "a field of type geometry_msgs/Pose or PoseStamped", slot)
        return lambda goal: _pose(goal, name, filling.frame or frame)
    if source == "frame":
        _require(isinstance(slot, definition.AbstractString), where, "a field for a text", slot)
        return lambda _: frame
    _require(getattr(slot, "typename", "") in _FLOATS, where, "a field for a float", slot)
    variable = filling.goal_variable
    assert variable is not None
    return lambda goal: float(goal_values(goal)[variable])


def _pose(goal: Goal, name: str, frame: str) -> Any:
    pose = pose_of(goal.pose)
    if name == "Pose":
        return pose
    stamped = PoseStamped(pose=pose)
    stamped.header.frame_id = frame
    return stamped


def check_result(call: RemoteCall, kind: Any) -> None:
    """Make sure that the result's message has the fields that are read; raises RemoteError."""
    for number, expected in enumerate(call.success.fields):
        where = f"success.fields[{number}]"
        _fitting(expected.equals, _slot(kind, expected.field, where), where)
    if call.success.reason is not None:
        _slot(kind, call.success.reason, "success.reason")


# Paths


def _slot(kind: Any, path: str, where: str) -> Any:
    """Return the type of the field at a path; raises RemoteError."""
    slot: Any = None
    for name, indexed in parts(path):
        fields = (
            {} if kind is None else dict(zip(kind.get_fields_and_field_types(), kind.SLOT_TYPES, strict=True))
        )
        if name not in fields:
            known = f"one of {', '.join(fields)}" if fields else f"nothing within {_described(slot)}"
            if isinstance(slot, definition.AbstractNestedType):
                known = f"{path.partition('.' + name)[0]}[0].{name}, as it is a list"
            raise RemoteError(f"{where}.field: expected {known}, got {quoted(name)} in {quoted(path)}")
        slot = fields[name]
        if indexed:
            _require(isinstance(slot, definition.AbstractSequence), where, f"a sequence for {name}[0]", slot)
            slot = slot.value_type
        kind = _class_of(slot)
    return slot


def _class_of(slot: Any) -> Any:
    """Return the class of a message; None for what is no message."""
    if not isinstance(slot, definition.NamespacedType):
        return None
    return getattr(importlib.import_module(".".join(slot.namespaces)), slot.name)


def _put(message: Any, path: str, value: Any) -> None:
    """Set the field at a path; sequences on the way get one item."""
    *way, (last, indexed) = parts(path)
    for name, only in way:
        if only and not getattr(message, name):
            slots = dict(zip(message.get_fields_and_field_types(), message.SLOT_TYPES, strict=True))
            setattr(message, name, [_class_of(slots[name].value_type)()])
        message = getattr(message, name)[0] if only else getattr(message, name)
    setattr(message, last, [value] if indexed else value)


def _fitting(value: Any, slot: Any, where: str) -> Any:
    """Return a constant as a field of this type holds it; raises RemoteError."""
    kind = _described(slot)
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if isinstance(slot, definition.AbstractString):
        fits, kind = isinstance(value, str), "string"
    elif kind == "boolean":
        fits = isinstance(value, bool)
    elif kind in _FLOATS:
        fits, value = number, float(value) if number else value
    elif isinstance(slot, definition.BasicType) and "int" in kind:
        fits = number and isinstance(value, int) and np.iinfo(kind).min <= value <= np.iinfo(kind).max
    else:
        raise RemoteError(f"{where}: expected a field for a text, a number or a truth value, got {kind}")
    _require(fits, where, f"a constant of type {kind}", value)
    return value


def _require(holds: bool, where: str, expected: str, got: Any) -> None:
    if not holds:
        raise RemoteError(f"{where}: expected {expected}, got {_described(got)}")


def _described(got: Any) -> str:
    """Return a value, or the type of a field, as text for a message."""
    if isinstance(got, definition.NamespacedType):
        return "/".join((got.namespaces[0], got.name))
    if isinstance(got, definition.AbstractType):
        return str(getattr(got, "typename", type(got).__name__))
    return quoted(got)


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
