"""What a server's messages say: fields by their paths, and whether a result is a success."""

from __future__ import annotations

import math
from typing import Any

from ator_ros.actions.remote import RemoteCall, Scalar
from ator_ros.printable import printable, quoted

_STATUS = ("unknown", "accepted", "executing", "canceling", "succeeded", "canceled", "aborted")
"""Names of the states of action_msgs/GoalStatus, by number."""


def status_name(status: int) -> str:
    """Return the name of a goal's state."""
    return _STATUS[status] if 0 <= status < len(_STATUS) else str(status)


def failure_in(call: RemoteCall, status: int, result: Any) -> str | None:
    """Return in words why a result is no success; None where it is one."""
    success = call.success
    wrong = [] if status_name(status) in success.status else [f"its goal is {status_name(status)}"]
    for expected in success.fields:
        value = value_at(result, expected.field)
        if not _equal(value, expected.equals):
            wrong.append(f"{expected.field}: expected {quoted(expected.equals)}, got {quoted(value)}")
    if not wrong:
        return None
    said = "" if success.reason is None else str(value_at(result, success.reason) or "")
    return "; ".join(wrong) + (f" ({printable(said, 200)})" if said else "")


def _equal(value: Any, expected: Scalar) -> bool:
    if isinstance(expected, float):
        return isinstance(value, int | float) and math.isclose(value, expected, rel_tol=1e-6, abs_tol=1e-9)
    return bool(value == expected)


def parts(path: str) -> list[tuple[str, bool]]:
    """Return the names in a path, each with whether the only item of a sequence is meant."""
    return [(part.removesuffix("[0]"), part.endswith("[0]")) for part in path.split(".")]


def value_at(message: Any, path: str) -> Any:
    """Return the value at a path; None where a sequence on the way is empty."""
    for name, indexed in parts(path):
        message = getattr(message, name)
        if indexed and not len(message):
            return None
        message = message[0] if indexed else message
    return message
