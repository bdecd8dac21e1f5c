"""Truncation of long sequences in messages before rclpy converts them to Python objects.

rclpy converts a whole message before a callback sees it. A chain of 100,000 calls takes seconds, in which the
node does nothing else. Bounds in the interface files would not help: senders check them (rclpy with "Failed
to serialize ROS message: error not set"), receivers do not. A received message is a C structure whose layout
follows from the message's fields (rosidl's runtime for C), so the sizes of its sequences can be read and
reduced before the conversion. The items that are cut off are freed with the others, since rosidl frees a
sequence by its capacity, not by its size.

The way from DDS to the C structure remains: 30 to 65 ms for 100,000 calls (11 MB).
"""

from __future__ import annotations

import ctypes
import importlib
import sys
import types
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

from rosidl_parser import definition

_NUMBERS = {
    "boolean": ctypes.c_bool,
    "octet": ctypes.c_uint8,
    "float": ctypes.c_float,
    "double": ctypes.c_double,
    **{
        f"{sign}int{bits}": getattr(ctypes, f"c_{sign}int{bits}")
        for sign in ("", "u")
        for bits in (8, 16, 32, 64)
    },
}


class _Sized(ctypes.Structure):
    """A sequence or a string in rosidl's C structures."""

    _fields_ = (("data", ctypes.c_void_p), ("size", ctypes.c_size_t), ("capacity", ctypes.c_size_t))


@dataclass(frozen=True)
class _Sequence:
    """A sequence of messages or strings: its offset, and the size and the sequences of its items."""

    offset: int
    item_bytes: int
    within: tuple[_Sequence, ...]


def bounded(kind: Any, most: int) -> Any:
    """Return a type with which rclpy receives messages of type `kind` with truncated sequences.

    Parameters
    ----------
    kind : type
        A message type; received messages are instances of it.
    most : int
        Greatest length of each sequence of messages or strings. Sequences of numbers, and strings, are not
        truncated: their conversion is fast.
    """
    if kind._TYPE_SUPPORT is None:
        kind.__class__.__import_type_support__()
    found, convert = _sequences(kind), _converter_of(kind)

    def cut_and_convert(address: int) -> Any:
        _cut(address, found, most)
        return convert(address)

    callback = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p)(cut_and_convert)
    new = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)(
        ("PyCapsule_New", ctypes.pythonapi)
    )
    capsule = new(ctypes.cast(callback, ctypes.c_void_p), None, None)
    # rclpy asks the class of a type for its functions. The callback must live as long as the capsule.
    functions = {"_CONVERT_TO_PY": capsule, "_callback": callback}
    metaclass = type(f"Bounded{type(kind).__name__}", (type(kind),), functions)
    return metaclass(kind.__name__, (kind,), {"__slots__": ()})


def with_parts(kind: Any, **parts: Any) -> Any:
    """Return the service or action type `kind` with some of its message types replaced."""
    return types.new_class(kind.__name__, (kind,), {"metaclass": type(kind)}, lambda body: body.update(parts))


def _converter_of(kind: Any) -> Any:
    """Return the function that converts the C structure at an address to a Python object."""
    api, capsule = ctypes.pythonapi, type(kind)._CONVERT_TO_PY
    name = ctypes.PYFUNCTYPE(ctypes.c_char_p, ctypes.py_object)(("PyCapsule_GetName", api))
    pointer = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)(
        ("PyCapsule_GetPointer", api)
    )
    return ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p)(pointer(capsule, name(capsule)))


def _cut(address: int, sequences: tuple[_Sequence, ...], most: int) -> None:
    """Truncate the sequences of the message at `address`, and the sequences within."""
    for sequence in sequences:
        sized = _Sized.from_address(address + sequence.offset)
        sized.size = min(sized.size, most)
        if sequence.within:
            for item in range(sized.size):
                _cut(sized.data + item * sequence.item_bytes, sequence.within, most)


@cache
def _sequences(kind: Any) -> tuple[_Sequence, ...]:
    """Return the sequences of messages and strings in a message, including those of nested messages."""
    layout = _layout(kind)
    return tuple(
        found
        for number, slot in enumerate(kind.SLOT_TYPES)
        for found in _in_field(kind, slot, getattr(layout, f"field_{number}").offset)
    )


def _in_field(kind: Any, slot: Any, offset: int) -> Iterator[_Sequence]:
    """Yield the sequences in a field of the message `kind` that lies at `offset`."""
    items = getattr(slot, "value_type", None)
    if isinstance(slot, definition.NamespacedType):
        for found in _sequences(_message(kind, slot)):
            yield _Sequence(offset + found.offset, found.item_bytes, found.within)
    elif isinstance(slot, definition.Array):
        size = ctypes.sizeof(_c_type(kind, items))
        for item in range(slot.size):
            yield from _in_field(kind, items, offset + item * size)
    elif isinstance(slot, definition.AbstractSequence) and not isinstance(items, definition.BasicType):
        within = _sequences(_message(kind, items)) if isinstance(items, definition.NamespacedType) else ()
        yield _Sequence(offset, ctypes.sizeof(_c_type(kind, items)), within)


@cache
def _layout(kind: Any) -> Any:
    """Return the C structure of a message; fields are numbered, as names may be reserved words."""
    fields = [(f"field_{number}", _c_type(kind, slot)) for number, slot in enumerate(kind.SLOT_TYPES)]
    # C has no structures without fields: rosidl adds a byte.
    return type(kind.__name__, (ctypes.Structure,), {"_fields_": fields or [("nothing", ctypes.c_uint8)]})


def _c_type(kind: Any, slot: Any) -> Any:
    if isinstance(slot, definition.BasicType):
        return _NUMBERS[slot.typename]
    if isinstance(slot, definition.NamespacedType):
        return _layout(_message(kind, slot))
    if isinstance(slot, definition.Array):
        return _c_type(kind, slot.value_type) * slot.size
    return _Sized


def _message(kind: Any, slot: Any) -> Any:
    """Return the class of a message in a field of `kind`; the parts of an action lie beside each other."""
    beside = sys.modules[kind.__module__]
    return getattr(beside, slot.name, None) or getattr(
        importlib.import_module(".".join(slot.namespaces)), slot.name
    )
