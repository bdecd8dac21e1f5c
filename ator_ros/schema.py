"""Files as typed classes: cattrs structures parsed data strictly, and reports the first field that is wrong.

A schema is a dataclass. Its annotations define the fields: numbers are finite, nothing is converted
silently (no "3" for 3, no true for 1), a union is the first of its types that fits, and `Within` and `Must`
narrow further. Fields without a default are required. Unknown fields are an error. A schema's own
``__post_init__`` raises ValueError for constraints between fields.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
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

from cattrs import ClassValidationError, Converter, IterableValidationError
from cattrs.errors import ForbiddenExtraKeysError
from cattrs.gen import make_dict_structure_fn, make_dict_unstructure_fn, make_mapping_structure_fn, override

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
class Must:
    """In `Annotated`: what a value must be, in words, and whether it is."""

    expected: str
    holds: Callable[[Any], bool]

    def check(self, value: Any) -> str | None:
        """Return what was expected, if `value` is something else."""
        return None if self.holds(value) else self.expected


NAME = Must("a name of letters, digits and _", lambda text: text.isascii() and text.isidentifier())
NOT_EMPTY = Must("at least one", bool)


def structured(data: object, schema: type[T]) -> T:
    """Return parsed data as an instance of `schema`, a dataclass or a type built of them.

    Raises
    ------
    SchemaError
        It does not fit; the message names the first field that does not.
    """
    try:
        return _CONVERTER.structure(data, schema)
    except Exception as error:  # cattrs raises groups, schemas raise ValueError
        path, text = next(_problems(error, ""))
        raise SchemaError(f"{printable(path, _LONGEST)}: {text}" if path else text) from error


def unstructured(data: DataclassInstance) -> dict[str, Any]:
    """Return the fields of a dataclass as plain data for a file; the inverse of `structured`.

    Fields whose value and default are None are left out.
    """
    plain: dict[str, Any] = _CONVERTER.unstructure(data)
    return plain


def require(holds: bool, name: str, expected: str, value: object) -> None:
    """Raise ValueError about the field `name` unless `holds`; for a schema's ``__post_init__``."""
    if not holds:
        raise ValueError(f"{name}: expected {expected}; got {quoted(value)}")


def _problems(error: BaseException, path: str) -> Iterator[tuple[str, str]]:
    """Yield the errors in an exception group of cattrs, each with its path in the file."""
    if isinstance(error, ClassValidationError):
        named, others = error.group_exceptions()
        for inner, note in named:
            if not isinstance(inner, KeyError):
                yield from _problems(inner, f"{path}.{note.name}" if path else note.name)
        for inner in others:
            if not isinstance(inner, ForbiddenExtraKeysError):
                yield from _problems(inner, path)
        missing = [note.name for inner, note in named if isinstance(inner, KeyError)]
        unknown = [str(n) for e in others if isinstance(e, ForbiddenExtraKeysError) for n in e.extra_fields]
        if missing or unknown:
            found = [f"missing {', '.join(sorted(missing))}"] if missing else []
            found += [f"unknown {', '.join(sorted(unknown))}"] if unknown else []
            text = printable(" and ".join(found), _LONGEST)
            yield path, f"expected the fields {_names_of_fields(error.cl)}; {text}"
    elif isinstance(error, IterableValidationError):
        for inner, item in error.group_exceptions()[0]:
            place = f"[{item.index}]" if isinstance(item.index, int) else f".{item.index}"
            yield from _problems(inner, path + place)
    else:
        yield path, str(error)


def _wrong(expected: str, value: object) -> ValueError:
    """Return the error for an unexpected value."""
    return ValueError(f"expected {expected}; got {quoted(value)}")


def _names_of_fields(schema: Any) -> str:
    """Return the fields of a schema for a message, optional ones in brackets."""
    needed = [item for item in fields(schema) if item.default is item.default_factory is MISSING]
    others = sorted(item.name for item in fields(schema) if item not in needed)
    there = ", ".join(sorted(item.name for item in needed))
    return f"{there} [{', '.join(others)}]" if others else there


def _number(value: Any, _: object = None) -> float:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not abs(value) <= sys.float_info.max:  # an int may be greater, too
        raise _wrong("a finite number", value)
    return float(value)


def _exactly(kind: type[T], name: str) -> Callable[[object, object], T]:
    def structure(value: object, _: object) -> T:
        if type(value) is not kind:
            raise _wrong(name, value)
        return value

    return structure


def _list(converter: Converter, kind: Any) -> Callable[[object, object], tuple[Any, ...]]:
    inner: Any = list[get_args(kind)[0]]  # type: ignore[misc]

    def structure(value: object, _: object) -> tuple[Any, ...]:
        if not isinstance(value, list):
            raise _wrong("a list", value)
        return tuple(converter.structure(value, inner))

    return structure


def _as(converter: Converter, kind: Any) -> Callable[[object, object], Any]:
    return lambda value, _: converter.structure(value, kind)


def _table(converter: Converter, kind: Any) -> Callable[[Any, Any], Any]:
    inner: Any
    if is_dataclass(kind):
        wanted = f"a table with {_names_of_fields(kind)}"
        # cattrs itself drops Annotated from the annotations of a dataclass.
        hints = get_type_hints(kind, include_extras=True)
        hooks: Any = {
            item.name: override(struct_hook=_as(converter, hints[item.name])) for item in fields(kind)
        }
        inner = make_dict_structure_fn(
            cast("type[Any]", kind),
            converter,
            _cattrs_forbid_extra_keys=True,
            _cattrs_detailed_validation=True,
            **hooks,
        )
    else:
        wanted = "a table"
        inner = make_mapping_structure_fn(kind, converter, dict, detailed_validation=True)

    def structure(value: object, to: object) -> Any:
        if not isinstance(value, Mapping):
            raise _wrong(wanted, value)
        return inner(value, to)

    return structure


def _narrowed(converter: Converter, kind: Any) -> Callable[[object, object], Any]:
    inner, *limits = get_args(kind)

    def structure(value: object, _: object) -> Any:
        result = converter.structure(value, inner)
        for limit in limits:
            if expected := limit.check(result):
                raise _wrong(expected, value)
        return result

    return structure


def _literal(converter: Converter, texts: tuple[str, ...]) -> Callable[[object, object], Any]:
    return _narrowed(converter, Annotated[str, Must(f"one of {', '.join(texts)}", texts.__contains__)])


def _either(converter: Converter, kind: Any) -> Callable[[object, object], Any]:
    """Return the hook of a union: the first table with all fields, else the first type that fits."""
    kinds = [inner for inner in get_args(kind) if inner is not NoneType]
    tables: list[Any] = [inner for inner in kinds if is_dataclass(inner)]

    def structure(value: object, _: object) -> Any:
        if value is None and NoneType in get_args(kind):
            return None
        if len(kinds) == 1:
            return converter.structure(value, kinds[0])
        if tables and isinstance(value, Mapping):
            suited = [inner for inner in tables if set(value) <= {item.name for item in fields(inner)}]
            return converter.structure(value, (suited or tables)[0])
        for inner in kinds:
            try:
                return converter.structure(value, inner)
            except ValueError:
                continue
        words = (
            f"a table with {_names_of_fields(one)}" if one in tables else _WORDS.get(one, "a list")
            for one in kinds
        )
        raise _wrong(" or ".join(words), value)

    return structure


def _plain(converter: Converter, kind: Any) -> Callable[[Any], dict[str, Any]]:
    """Return the hook that turns a dataclass into plain data, without fields that are None by default."""
    optional = {item.name for item in fields(kind) if item.default is None}
    whole = make_dict_unstructure_fn(cast("type[Any]", kind), converter)

    def unstructure(data: Any) -> dict[str, Any]:
        values = whole(data).items()  # cattrs itself would move optional fields to the end
        return {name: value for name, value in values if value is not None or name not in optional}

    return unstructure


def _converter() -> Converter:
    converter = Converter()
    for kind, hook in _HOOKS.items():
        converter.register_structure_hook(kind, hook)
    factories: tuple[tuple[Callable[[Any], bool], Callable[[Any], Any]], ...] = (
        (lambda kind: get_origin(kind) is tuple, lambda kind: _list(converter, kind)),
        (
            lambda kind: get_origin(kind) in (dict, Mapping) or is_dataclass(kind),
            lambda kind: _table(converter, kind),
        ),
        (lambda kind: get_origin(kind) is Annotated, lambda kind: _narrowed(converter, kind)),
        (lambda kind: get_origin(kind) is Literal, lambda kind: _literal(converter, get_args(kind))),
        (lambda kind: get_origin(kind) in (Union, UnionType), lambda kind: _either(converter, kind)),
    )
    for applies, factory in factories:
        converter.register_structure_hook_factory(applies, factory)
    converter.register_unstructure_hook_factory(is_dataclass, lambda kind: _plain(converter, kind))
    return converter


_WORDS: Mapping[Any, str] = {
    float: "a finite number",
    int: "a whole number",
    bool: "true or false",
    str: "a text",
}
_HOOKS: Mapping[Any, Callable[[object, object], Any]] = {
    float: _number,
    **{kind: _exactly(kind, _WORDS[kind]) for kind in (int, bool, str)},
}
_CONVERTER = _converter()
