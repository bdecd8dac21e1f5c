"""The messages of an action's services by its .action file: recordings do not define them."""

from __future__ import annotations

import re
from typing import Any

from ator_ros.resources import interface_text

_SECTION = re.compile(r"^---\s*$", re.MULTILINE)
_REFERENCE = re.compile(r"^\s*([a-z]\w*/)?(?:msg/)?([A-Z]\w*)(?:\[[^\]]*\])?\s+[a-z]", re.MULTILINE)
_EVENTS = {
    "SendGoal_Request": "unique_identifier_msgs/UUID goal_id\n{own}_Goal goal",
    "SendGoal_Response": "bool accepted\nbuiltin_interfaces/Time stamp",
    "GetResult_Request": "unique_identifier_msgs/UUID goal_id",
    "GetResult_Response": "int8 status\n{own}_Result result",
}
"""The messages of an action's services by the ends of their names."""


def types_of(action: str) -> dict[str, Any]:
    """Return the types of an action's services and of the messages within, as rosbags registers them.

    Raises
    ------
    ResourceError
        The action, or a message within, is not installed.
    """
    from rosbags.typesys import get_types_from_msg

    package, _, kind = action.split("/")
    text = interface_text(package, "action", kind)
    goal, result, *_ = _SECTION.split(text)
    texts = {f"{action}_Goal": goal, f"{action}_Result": result}
    for end, fields in _EVENTS.items():
        texts[f"{action}_{end}"] = fields.format(own=action)
    for service in ("SendGoal", "GetResult"):
        parts = (f"{action}_{service}_{part}[<=1] {part.lower()}" for part in ("Request", "Response"))
        texts[f"{action}_{service}_Event"] = "\n".join(("service_msgs/ServiceEventInfo info", *parts))
    # In an .action file a bare name is a message of the same package.
    bare = re.compile(r"^(\s*)([A-Z]\w*)(?=[\s\[])", re.MULTILINE)
    types: dict[str, Any] = {}
    for name, fields in texts.items():
        types |= get_types_from_msg(bare.sub(rf"\g<1>{package}/\2", fields), name)
    for name, fields in _messages_within(package, "\n".join(texts.values())).items():
        types |= get_types_from_msg(fields, name)
    return types


def _messages_within(package: str, text: str) -> dict[str, str]:
    """Return the definitions of the messages that a text names, and of those that these name in turn."""
    found: dict[str, str] = {}
    waiting = [(package, text)]
    while waiting:
        own, fields = waiting.pop()
        for where, kind in _REFERENCE.findall(fields):
            holder = where.rstrip("/") or own
            name = f"{holder}/msg/{kind}"
            if name not in found:
                found[name] = interface_text(holder, "msg", kind)
                waiting.append((holder, found[name]))
    return found
