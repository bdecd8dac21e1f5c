"""Schemas of files: dataclasses whose annotations are checked strictly.

Numbers are finite, and nothing is converted (no "3" for 3, no true for 1). A union is the first of
its types that fits. `Within` and `Must` restrict values further. Fields without a default are
required, and unknown fields are errors. ``__post_init__`` of a schema raises ValueError for
constraints between fields.
"""

from __future__ import annotations

import functools
import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from types import NoneType, UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Literal,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from ator_ros.printable import ReadableError, printable, quoted

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T")
_LONGEST = 200  # characters of a path, and of the fields that are missing or unknown


class SchemaError(ReadableError, ValueError):
    """Data does not fit its schema; the message is one line: field, expected, actual."""


@dataclass(frozen=True)
class Within:
    """In `Annotated`: a number from `least` to `most`."""

    least: float = -math.inf
    most: float = math.inf

    def check(self, value: float) -> str | None:
        """Return what was expected; None if `value` is valid."""
        if self.least <= value <= self.most:
            return None
        if math.isinf(self.most):
            return f"a finite number of at least {self.least:g}"
        return f"a number from {self.least:g} to {self.most:g}"


@dataclass(frozen=True)
class Must:
    """In `Annotated`: what is expected, in words, and a test of the value."""

    expected: str
    holds: Callable[[Any], bool]

    def check(self, value: Any) -> str | None:
        """Return what was expected; None if `value` is valid."""
        return None if self.holds(value) else self.expected


NAME = Must("a name of letters, digits and _", lambda text: text.isascii() and text.isidentifier())
TITLE = Must("a printable name of up to 60 characters", lambda text: printable(text) == text)
NOT_EMPTY = Must("at least one", bool)


def structured(data: object, schema: type[T]) -> T:
    """Return parsed data as `schema`, which is a dataclass or a type that contains dataclasses.

    Raises SchemaError if the data does not fit; the message names the first wrong field.
    """
    try:
        value: T = _read(data, schema, "")
    except RecursionError as error:
        raise SchemaError("expected data that is nested less deeply") from error
    return value


def unstructured(data: DataclassInstance) -> dict[str, Any]:
    """Return the fields of a dataclass as plain data for a file; the inverse of `structured`.

    Fields whose value and default are None are omitted.
    """
    values = ((item, getattr(data, item.name)) for item in fields(data))
    return {
        item.name: _plain(value)
        for item, value in values
        if value is not None or item.default is not None
    }


def _plain(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return unstructured(value)
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, tuple | list) else value


def require(
    holds: bool,
    path: str,
    expected: str,
    value: object,
) -> None:
    """Raise SchemaError about the field at `path` unless `holds`; also for ``__post_init__``."""
    if not holds:
        raise _error(path, f"expected {expected}; got {quoted(value)}")


def _error(path: str, text: str) -> SchemaError:
    return SchemaError(f"{printable(path, _LONGEST)}: {text}" if path else text)


_WORDS: Mapping[Any, str] = {
    float: "a finite number",
    int: "a whole number",
    bool: "true or false",
    str: "a text",
}


def _read(
    value: Any,
    kind: Any,
    path: str,
) -> Any:
    """Return the value at a path of the data as the annotated type `kind`."""
    if kind is float:
        number = isinstance(value, int | float) and not isinstance(value, bool)
        # An int may be greater than any float.
        require(number and abs(value) <= sys.float_info.max, path, _WORDS[float], value)
        return float(value)
    if kind in (int, bool, str):
        require(type(value) is kind, path, _WORDS[kind], value)
        return value
    if is_dataclass(kind):
        return _table(value, kind, path)
    origin = get_origin(kind)
    inner = get_args(kind)
    if origin is tuple:
        require(isinstance(value, list), path, "a list", value)
        return tuple(
            _read(item, inner[0], f"{path}[{number}]") for number, item in enumerate(value)
        )
    if origin in (dict, Mapping):
        require(isinstance(value, Mapping), path, "a table", value)
        places = {key: f"{path}.{key}" for key in value}
        return {
            _read(key, inner[0], at): _read(value[key], inner[1], at) for key, at in places.items()
        }
    if origin is Annotated:
        read = _read(value, inner[0], path)
        for limit in inner[1:]:
            expected = limit.check(read)
            require(expected is None, path, expected, value)
        return read
    if origin is Literal:
        return _read(
            value, Annotated[str, Must(f"one of {', '.join(inner)}", inner.__contains__)], path
        )
    return _either(value, inner, path) if origin in (Union, UnionType) else value


@functools.cache
def _hints(schema: Any) -> dict[str, Any]:
    hints = get_type_hints(schema, include_extras=True)
    return {item.name: hints[item.name] for item in fields(schema)}


def _table(
    value: Any,
    schema: Any,
    path: str,
) -> Any:
    """Return a table as a dataclass; wrong fields are reported before missing and unknown ones."""
    names = _names_of_fields(schema)
    hints = _hints(schema)
    require(isinstance(value, Mapping), path, f"a table with {names}", value)
    read = {
        name: _read(value[name], kind, f"{path}.{name}" if path else name)
        for name, kind in hints.items()
        if name in value
    }
    missing = sorted(_required(schema) - read.keys())
    unknown = sorted(str(name) for name in value.keys() - hints.keys())
    if missing or unknown:
        found = [f"missing {', '.join(missing)}"] if missing else []
        found += [f"unknown {', '.join(unknown)}"] if unknown else []
        raise _error(
            path, f"expected the fields {names}; {printable(' and '.join(found), _LONGEST)}"
        )
    try:
        return schema(**read)
    except Exception as error:  # of its __post_init__
        raise _error(path, str(error)) from error


def _required(schema: Any) -> set[str]:
    return {item.name for item in fields(schema) if item.default is item.default_factory is MISSING}


@functools.cache
def _names_of_fields(schema: Any) -> str:
    """Return the fields of a schema for a message, optional ones in brackets."""
    required = _required(schema)
    optional = ", ".join(sorted(_hints(schema).keys() - required))
    return f"{', '.join(sorted(required))}{f' [{optional}]' if optional else ''}"


def _either(
    value: Any,
    kinds: tuple[Any, ...],
    path: str,
) -> Any:
    """Return a value as the first schema with all its fields, else as the first type that fits."""
    if value is None and NoneType in kinds:
        return None
    kinds = tuple(kind for kind in kinds if kind is not NoneType)
    tables: list[Any] = [kind for kind in kinds if is_dataclass(kind)]
    if tables and isinstance(value, Mapping):
        suitable = [kind for kind in tables if value.keys() <= _hints(kind).keys()]
        kinds = ((suitable or tables)[0],)
    if len(kinds) == 1:
        return _read(value, kinds[0], path)
    for kind in kinds:
        try:
            return _read(value, kind, path)
        except SchemaError:
            continue
    words = (
        f"a table with {_names_of_fields(kind)}" if kind in tables else _WORDS.get(kind, "a list")
        for kind in kinds
    )
    raise _error(path, f"expected {' or '.join(words)}; got {quoted(value)}")
