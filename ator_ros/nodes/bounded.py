"""Messages that are cut to size before rclpy makes Python objects of them.

rclpy converts all of a message before anybody sees it: a chain of 100,000 calls takes seconds, in which a
node does nothing else. Bounds in the interface files would not help: only senders check those (rclpy's with
"Failed to serialize ROS message: error not set"), receivers take whatever comes. What arrived is a C
structure whose layout follows from the message's fields (rosidl's runtime for C), so the sizes of its
sequences can be read, and made smaller, before it is converted. The items that are cut off are freed with
the others: rosidl goes by a sequence's capacity, not by its size.

What remains is the way from DDS to the C structure: 30 to 50 ms for 100,000 calls (11 MB).
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
    """A sequence or a string, as rosidl keeps it."""

    _fields_ = (("data", ctypes.c_void_p), ("size", ctypes.c_size_t), ("capacity", ctypes.c_size_t))


@dataclass(frozen=True)
class _Sequence:
    """A sequence of messages or strings: where it lies in its message, its items' bytes and sequences."""

    offset: int
    item_bytes: int
    within: tuple[_Sequence, ...]


def bounded(kind: Any, most: int) -> Any:
    """Return a type with which rclpy takes messages of type `kind` that are cut to size.

    Parameters
    ----------
    kind : type
        A type of message; it is what the messages still are.
    most : int
        How many messages or strings remain in each sequence of them. Sequences of numbers, and texts, stay
        whole: they are fast.
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
    """Return the service or action type `kind` with other types for some of its messages."""
    return types.new_class(kind.__name__, (kind,), {"metaclass": type(kind)}, lambda body: body.update(parts))


def _converter_of(kind: Any) -> Any:
    """Return what makes a Python object of the C structure at an address."""
    api, capsule = ctypes.pythonapi, type(kind)._CONVERT_TO_PY
    name = ctypes.PYFUNCTYPE(ctypes.c_char_p, ctypes.py_object)(("PyCapsule_GetName", api))
    pointer = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)(
        ("PyCapsule_GetPointer", api)
    )
    return ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p)(pointer(capsule, name(capsule)))


def _cut(address: int, sequences: tuple[_Sequence, ...], most: int) -> None:
    """Make the sequences of the message at `address`, and those within, as short as they may be."""
    for sequence in sequences:
        sized = _Sized.from_address(address + sequence.offset)
        sized.size = min(sized.size, most)
        if sequence.within:
            for item in range(sized.size):
                _cut(sized.data + item * sequence.item_bytes, sequence.within, most)


@cache
def _sequences(kind: Any) -> tuple[_Sequence, ...]:
    """Return the sequences of messages and strings in a message, those of its parts included."""
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
    """Return the C structure of a message; its fields are numbered, as their own names may mean something."""
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
