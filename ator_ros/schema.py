"""Files as typed classes: parsed data are structured strictly, and the first field that is wrong is reported.

A schema is a dataclass. Its annotations define the fields: numbers are finite, nothing is converted
silently (no "3" for 3, no true for 1), a union is the first of its types that fits, and `Within`, `OneOf`,
`Name` and `AtMost` narrow further. Fields without a default are required. A schema's own ``__post_init__``
raises ValueError for constraints between fields.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Mapping, Sequence, Sized
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Literal,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

from ator_ros.printable import printable, quoted

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T")
_LONGEST = 200  # characters of a path, and of the fields that are missing or unknown


class SchemaError(ValueError):
    """Data that does not fit its schema; the message is one line: field, expected, actual."""


@dataclass(frozen=True)
class Within:
    """In `Annotated`: a number lies from `least` to `most`."""

    least: float = -math.inf
    most: float = math.inf

    def check(self, value: float) -> str | None:
        """Return what was expected, if `value` lies outside."""
        if self.least <= value <= self.most:
            return None
        if math.isinf(self.most):
            return f"a finite number of at least {self.least:g}"
        return f"a number from {self.least:g} to {self.most:g}"


@dataclass(frozen=True)
class OneOf:
    """In `Annotated`: a text is one of `names`."""

    names: tuple[str, ...]

    def check(self, value: str) -> str | None:
        """Return what was expected, if `value` is none of the names."""
        return None if value in self.names else f"one of {', '.join(self.names)}"


@dataclass(frozen=True)
class Name:
    """In `Annotated`: a text is a name of letters, digits and _, not beginning with a digit."""

    def check(self, value: str) -> str | None:
        """Return what was expected, if `value` is no name."""
        return None if value.isascii() and value.isidentifier() else "a name of letters, digits and _"


@dataclass(frozen=True)
class AtMost:
    """In `Annotated`: a list or a table has at most `most` entries."""

    most: int

    def check(self, value: Sized) -> str | None:
        """Return what was expected, if `value` has more."""
        return None if len(value) <= self.most else f"at most {self.most} entries"


def structured(data: object, schema: type[T], where: str = "", *, closed: bool = False) -> T:
    """Return `data` as an instance of `schema`.

    Parameters
    ----------
    data : object
        Parsed data.
    schema : type
        A dataclass, or a type built of them.
    where : str
        Path of `data` in its file, for messages.
    closed : bool
        Whether fields that the schema lacks are an error; otherwise they are ignored.

    Raises
    ------
    SchemaError
        It does not fit; the message names the first field that does not.
    """
    try:
        return cast("T", _structured(data, schema, closed))
    except _MisfitError as error:
        path = "".join([where, *error.path]).removeprefix(".")
        raise SchemaError(f"{printable(path, _LONGEST)}: {error}" if path else str(error)) from error


def unstructured(data: DataclassInstance) -> dict[str, Any]:
    """Return the fields of a dataclass as plain data for a file; the inverse of `structured`.

    Fields whose value and default are None are left out.
    """
    values = [(item, getattr(data, item.name)) for item in fields(data)]
    return {i.name: _plain(value) for i, value in values if value is not None or i.default is not None}


def _plain(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return unstructured(value)
    if isinstance(value, Mapping):
        return {name: _plain(item) for name, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value


def require(holds: bool, name: str, expected: str, value: object) -> None:
    """Raise ValueError about the field `name` unless `holds`; for a schema's ``__post_init__``."""
    if not holds:
        raise ValueError(f"{name}: expected {expected}; got {quoted(value)}")


class _MisfitError(ValueError):
    """Data that do not fit, with their path, from the outside in."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self.path: list[str] = []


def _wrong(expected: str, value: object) -> _MisfitError:
    return _MisfitError(f"expected {expected}; got {quoted(value)}")


_WORDS: Mapping[Any, str] = {
    float: "a finite number",
    int: "a whole number",
    bool: "true or false",
    str: "a text",
}


def _structured(value: Any, kind: Any, closed: bool) -> Any:
    """Return a value as an instance of any type that the annotations of a schema contain."""
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _narrowed(_structured(value, arguments[0], closed), arguments[1:], value)
    if origin is Literal:
        return _narrowed(_structured(value, str, closed), [OneOf(arguments)], value)
    if origin in (Union, UnionType):
        return _either(value, arguments, closed)
    if is_dataclass(kind):
        return _table(value, kind, closed)
    if origin is tuple:
        if not isinstance(value, list):
            raise _wrong("a list", value)
        return tuple(_inside(f"[{n}]", item, arguments[0], closed) for n, item in enumerate(value))
    if origin in (dict, Mapping):
        if not isinstance(value, Mapping):
            raise _wrong("a table", value)
        names = [_inside(f".{name}", name, str, closed) for name in value]
        return {name: _inside(f".{name}", value[name], arguments[1], closed) for name in names}
    if kind is float and type(value) in (int, float) and abs(value) <= sys.float_info.max:
        return float(value)
    if kind is not Any and (type(value) is not kind or kind is float):
        raise _wrong(_WORDS[kind], value)
    return value


def _inside(place: str, value: Any, kind: Any, closed: bool) -> Any:
    """Return a part of a list or a table; an error gets its place."""
    try:
        return _structured(value, kind, closed)
    except _MisfitError as error:
        error.path.insert(0, place)
        raise


def _narrowed(result: Any, limits: Iterable[Any], value: Any) -> Any:
    for limit in limits:
        if expected := limit.check(result):
            raise _wrong(expected, value)
    return result


@cache
def _hints(schema: Any) -> dict[str, Any]:
    return get_type_hints(schema, include_extras=True)


def _table(value: Any, schema: Any, closed: bool) -> Any:
    if not isinstance(value, Mapping):
        raise _wrong(f"a table with {_names_of_fields(schema)}", value)
    hints = _hints(schema)
    given = {
        item.name: _inside(f".{item.name}", value[item.name], hints[item.name], closed)
        for item in fields(schema)
        if item.name in value
    }
    missing = sorted(_needed(schema) - given.keys())
    unknown = sorted(map(str, value.keys() - hints.keys())) if closed else []
    if missing or unknown:
        found = [f"missing {', '.join(missing)}"] if missing else []
        found += [f"unknown {', '.join(unknown)}"] if unknown else []
        text = printable(" and ".join(found), _LONGEST)
        raise _MisfitError(f"expected the fields {_names_of_fields(schema)}; {text}")
    try:
        return schema(**given)
    except ValueError as error:  # of its __post_init__
        raise _MisfitError(str(error)) from error


def _needed(schema: Any) -> set[str]:
    return {item.name for item in fields(schema) if item.default is item.default_factory is MISSING}


def _names_of_fields(schema: Any) -> str:
    """Return the fields of a schema for a message, optional ones in brackets."""
    needed = _needed(schema)
    others = sorted(item.name for item in fields(schema) if item.name not in needed)
    there = ", ".join(sorted(needed))
    return f"{there} [{', '.join(others)}]" if others else there


def _either(value: Any, kinds: Sequence[Any], closed: bool) -> Any:
    """Return a value as the first table with all its fields, else as the first type that fits."""
    if value is None and NoneType in kinds:
        return None
    kinds = [kind for kind in kinds if kind is not NoneType]
    tables: list[Any] = [kind for kind in kinds if is_dataclass(kind)]
    if tables and isinstance(value, Mapping):
        suited = [kind for kind in tables if value.keys() <= _hints(kind).keys()]
        kinds = (suited or tables)[:1]
    if len(kinds) == 1:
        return _structured(value, kinds[0], closed)
    for kind in kinds:
        try:
            return _structured(value, kind, closed)
        except _MisfitError:
            continue
    words = (
        f"a table with {_names_of_fields(kind)}" if kind in tables else _WORDS.get(kind, "a list")
        for kind in kinds
    )
    raise _wrong(" or ".join(words), value)
