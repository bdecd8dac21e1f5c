"""Definitions of messages in recordings: checked, and written again for the decoder.

A definition comes from the file, and so does the cost of a message: types without bytes, or nested
ones, would make any number of objects of a message. The decoder prints what it cannot parse, so it
gets nothing but the types and names of fields.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from ator_ros.printable import printable

LARGEST_DEFINITION = 1 << 16  # bytes; those of Nav2 have up to 20 kB
_MOST_FIELDS = 2000  # of all types of a definition; those of Nav2 have up to 150
_MOST_OBJECTS = 1000  # of a message without elements of arrays; a record has 60
_BYTES_PER_OBJECT = 4  # of the elements of arrays, at least; a GoalStatus has 5
_SIZES = {
    **dict.fromkeys(("bool", "byte", "char", "int8", "uint8"), 1),
    **dict.fromkeys(("int16", "uint16"), 2),
    **dict.fromkeys(("int32", "uint32", "float32", "string", "wstring"), 4),
    **dict.fromkeys(("int64", "uint64", "float64"), 8),
}
"""Least bytes of a field; texts and arrays begin with their length."""
_BYTES = ("byte", "uint8")
"""Types whose arrays the decoder reads as bytes."""
_LENGTH = 4  # bytes of the length of an array
_SEPARATOR = re.compile(r"={3,}")
_BEGIN = re.compile(r"MSG:\s+(\S+)")
_TYPE = re.compile(r"([a-z][a-z0-9_]*)/(?:(?:msg|action)/)?([A-Za-z][A-Za-z0-9_]*)")
_FIELD = re.compile(
    r"""(?:([a-z][a-z0-9_]*)/(?:(?:msg|action)/)?)?  ([A-Za-z][A-Za-z0-9_]*)  # type
        (?:<=[0-9]{1,9})?
        (\[ (<=)? ([0-9]{0,9}) \])?       \s+ ([A-Za-z][A-Za-z0-9_]*) \s* (=|$|\s)   # array, name
    """,
    re.VERBOSE,
)


class _Field(NamedTuple):
    """A field of a type; `length` is its number of elements, 0 if a message has it."""

    kind: str
    name: str
    is_array: bool
    length: int

    @property
    def is_sequence(self) -> bool:
        """Whether a message has the number of elements."""
        return self.is_array and not self.length

    def __str__(self) -> str:
        array = f"[{self.length or ''}]" if self.is_array else ""
        return f"{self.kind}{array} {self.name}"


class _Cost(NamedTuple):
    """Least bytes of a message, and objects in Python, without the elements of arrays.

    The decoder reads bytes beyond the end of a message as none; `ends` says whether something else
    is read, which ends a long array there.
    """

    size: int
    objects: int
    ends: bool


def checked_definition(kind: str, text: str) -> tuple[str, str]:
    """Return the name of a type, and its definition without comments, constants and defaults.

    Raises ValueError unless reading a message needs memory in proportion to its size.
    """
    if len(text) > LARGEST_DEFINITION:
        raise ValueError(
            f"expected a definition of at most {LARGEST_DEFINITION // 1024} KiB, "
            f"got {len(text) // 1024}"
        )
    name = _type_name(kind)
    types = _types_in(name, text)
    costs: dict[str, _Cost] = {}
    _cost(name, types, costs, ())
    sections = ["\n".join([f"MSG: {each}", *map(str, types[each])]) for each in costs]
    return name, "\n===\n".join(sections)


def _type_name(kind: str) -> str:
    """Return the name of a type in the form nav_msgs/Odometry.

    Underscores, as in types of actions, are left out, since the decoder's parser refuses them.
    """
    match = _TYPE.fullmatch(kind)
    if match is None:
        raise ValueError(f"expected a type such as nav_msgs/msg/Odometry, got {printable(kind)}")
    return f"{match[1]}/{match[2].replace('_', '')}"


def _types_in(name: str, text: str) -> dict[str, list[_Field]]:
    """Return the fields of each type in a definition, whose first type has a name."""
    time = [_Field("int32", "sec", False, 0), _Field("uint32", "nanosec", False, 0)]
    types = {"builtin_interfaces/Time": time, "builtin_interfaces/Duration": time, name: []}
    fields = types[name]
    count = 0
    for each in text.splitlines():
        line = each.partition("#")[0].strip()
        if not line or _SEPARATOR.fullmatch(line):
            continue
        if begin := _BEGIN.fullmatch(line):
            name = _type_name(begin[1])
            types[name] = fields = []
        elif field := _field_in(line, name):
            fields.append(field)
            count += 1
            if count > _MOST_FIELDS:
                raise ValueError(f"expected a definition of at most {_MOST_FIELDS} fields")
    return types


def _field_in(line: str, context: str) -> _Field | None:
    """Return the field in a line of the definition of a type; None if it is a constant."""
    match = _FIELD.match(line)
    if match is None:
        raise ValueError(f"expected a field of {context}, got {printable(line)}")
    package, kind, array, upper, count, name, after = match.groups()
    if after == "=":
        return None
    if package or kind not in _SIZES:
        kind = _type_name(f"{package or context.partition('/')[0]}/{kind}")
    fixed = int(count or 0) if array and not upper else 0
    if array and count == "0":
        raise ValueError(f"expected arrays with elements in {context}, got {printable(line)}")
    return _Field(kind, name, bool(array), fixed)


def _cost(
    name: str, types: dict[str, list[_Field]], costs: dict[str, _Cost], users: tuple[str, ...]
) -> _Cost:
    """Return the cost of a type; `costs` are those known, and `users` the types that contain it."""
    if name in costs:
        return costs[name]
    if name in users:
        raise ValueError(f"expected a type that does not contain itself, got {name}")
    if name not in types:
        raise ValueError(f"expected a definition of {name}, there is none")
    size = 0
    objects = 1
    ends = not types[name]  # it has a byte that is not in the definition
    for field in types[name]:
        if field.kind in _SIZES:
            one = _Cost(_SIZES[field.kind], 0, not (field.length and field.kind in _BYTES))
        else:
            one = _cost(field.kind, types, costs, (*users, name))
        is_ended = one.ends or field.kind in _BYTES
        if field.is_array and (_BYTES_PER_OBJECT * one.objects > one.size or not is_ended):
            raise ValueError(
                f"{name}: expected elements of at least {_BYTES_PER_OBJECT} bytes for each "
                f"object, got {one.size} bytes and {one.objects} objects in {field.kind}"
            )
        size += _LENGTH if field.is_sequence else one.size * max(1, field.length)
        objects += field.is_array + one.objects * (field.length if field.is_array else 1)
        ends = ends or field.is_sequence or one.ends
        if objects > _MOST_OBJECTS:
            raise ValueError(f"{name}: expected at most {_MOST_OBJECTS} objects, got more")
    costs[name] = _Cost(size or 1, objects, ends)
    return costs[name]
