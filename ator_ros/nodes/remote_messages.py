"""Goals of any action type, found at run time; their fields are set by paths."""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped
from std_msgs.msg import Header

from ator_ros.actions.base import Goal
from ator_ros.actions.goal_variables import goal_values
from ator_ros.actions.remote import Filling, RemoteCall, parts
from ator_ros.nodes.messages import pose_of
from ator_ros.printable import ReadableError, printable, quoted

_FLOATS = ("float", "double")
_TEXTS = ("string", "wstring")
_POSES = ("geometry_msgs/Pose", "geometry_msgs/PoseStamped")
_SEQUENCE = re.compile(r"sequence<([^,]+)(?:, \d+)?>")


class RemoteError(ReadableError, ValueError):
    """An action server that cannot be used as declared."""


class RemoteInterface:
    """The action type `kind` of a server, and its goals; states are in the frame `frame`.

    Raises RemoteError if the type is not installed, lacks a field that is written or read, or has
    one that cannot hold its value.
    """

    def __init__(self, call: RemoteCall, frame: str) -> None:
        self.kind = action_type(call.type)
        self._writers = [
            (filling.field, _writer(filling, self.kind.Goal, frame, f"goal[{number}]"))
            for number, filling in enumerate(call.goal)
        ]
        for number, expected in enumerate(call.success.fields):
            where = f"success.fields[{number}]"
            _fitting(expected.equals, _type_at(self.kind.Result, expected.field, where), where)
        if call.success.reason is not None:
            _type_at(self.kind.Result, call.success.reason, "success.reason")

    def written(self, goals: Sequence[Goal]) -> Any:
        """Return the message for a goal, or for several ones of a server that drives through them.

        Fields with one value have that of the last one.
        """
        message = self.kind.Goal()
        for path, value in self._writers:
            _put(message, path, value(goals))
        return message


def action_type(name: str) -> Any:
    """Import an action type, as nav2_msgs/action/NavigateToPose."""
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


def _writer(filling: Filling, kind: Any, frame: str, where: str) -> Callable[[Sequence[Goal]], Any]:
    """Return the function from goals to the value of a field."""
    slot = _type_at(kind, filling.field, where)
    source = filling.source
    if source is None:
        constant = _fitting(filling.constant, slot, where)
        return lambda _: constant
    if source == "goal":
        _require(slot in _POSES, where, "a field of type geometry_msgs/Pose or PoseStamped", slot)
        return lambda goals: _pose(slot, filling.frame or frame, goals[-1])
    if source == "goals":
        sequence = _SEQUENCE.fullmatch(slot)
        item = sequence[1] if sequence else slot
        listed = sequence is not None and item in _POSES
        _require(listed, where, "a list of geometry_msgs/Pose or PoseStamped", slot)
        return lambda goals: [_pose(item, filling.frame or frame, goal) for goal in goals]
    if source == "frame":
        _require(slot.startswith(_TEXTS), where, "a field for a text", slot)
        return lambda _: frame
    _require(slot in _FLOATS, where, "a field for a float", slot)
    variable = filling.goal_variable
    assert variable is not None
    return lambda goals: float(goal_values(goals[-1])[variable])


def _pose(slot: str, frame: str, goal: Goal) -> Any:
    pose = pose_of(goal.pose)
    if slot == "geometry_msgs/Pose":
        return pose
    return PoseStamped(header=Header(frame_id=frame), pose=pose)


def _type_at(kind: Any, path: str, where: str) -> str:
    """Return the type of the field at a path, as `get_fields_and_field_types` does.

    Raises RemoteError.
    """
    slot = ""
    for name, indexed in parts(path):
        fields = {} if kind is None else kind.get_fields_and_field_types()
        if name not in fields:
            known = f"one of {', '.join(fields)}" if fields else f"nothing within {slot}"
            raise RemoteError(
                f"{where}.field: expected {known}, got {quoted(name)} in {quoted(path)}"
            )
        slot = fields[name]
        if indexed:
            sequence = _SEQUENCE.fullmatch(slot)
            _require(sequence is not None, where, f"a sequence for {name}[0]", slot)
            slot = sequence[1] if sequence else slot
        kind = _class_of(slot)
    return slot


def _class_of(slot: str) -> Any:
    """Return the class of a message type; None for other types."""
    package, _, name = slot.partition("/")
    return getattr(importlib.import_module(f"{package}.msg"), name) if name.isidentifier() else None


def _put(message: Any, path: str, value: Any) -> None:
    """Set the field at a path; empty sequences on the path get one item."""
    *parents, (last, indexed) = parts(path)
    for name, is_sequence in parents:
        if is_sequence and not getattr(message, name):
            sequence = _SEQUENCE.fullmatch(message.get_fields_and_field_types()[name])
            assert sequence is not None  # checked before
            setattr(message, name, [_class_of(sequence[1])()])
        message = getattr(message, name)[0] if is_sequence else getattr(message, name)
    setattr(message, last, [value] if indexed else value)


def _fitting(value: Any, slot: str, where: str) -> Any:
    """Return a constant for a field of type `slot`; raises RemoteError."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if slot.startswith(_TEXTS):
        fits = isinstance(value, str)
    elif slot == "boolean":
        fits = isinstance(value, bool)
    elif slot in _FLOATS:
        fits = number
        value = float(value) if number else value
    elif re.fullmatch(r"u?int\d+", slot):
        fits = (
            number and isinstance(value, int) and np.iinfo(slot).min <= value <= np.iinfo(slot).max
        )
    else:
        raise RemoteError(
            f"{where}: expected a field for a text, a number or a truth value, got {slot}"
        )
    _require(fits, where, f"a constant of type {slot}", quoted(value))
    return value


def _require(holds: bool, where: str, expected: str, got: str) -> None:
    if not holds:
        raise RemoteError(f"{where}: expected {expected}, got {got}")
