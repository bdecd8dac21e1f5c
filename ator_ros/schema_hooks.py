"""How cattrs structures schemas strictly, and the words for what does not fit; see `ator_ros.schema`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from cattrs import Converter
from cattrs.gen import make_dict_structure_fn, make_dict_unstructure_fn, make_mapping_structure_fn, override

from ator_ros.printable import short

T = TypeVar("T")


def wrong(expected: str, value: object) -> ValueError:
    """Return the error of a value that is not what was expected."""
    return ValueError(f"expected {expected}; got {short(value)}")


def names_of_fields(schema: Any) -> str:
    """Return the fields of a schema as a message lists them, those that may be left out in brackets."""
    needed = [item for item in fields(schema) if item.default is item.default_factory is MISSING]
    others = sorted(item.name for item in fields(schema) if item not in needed)
    there = ", ".join(sorted(item.name for item in needed))
    return f"{there} [{', '.join(others)}]" if others else there


def _number(value: Any, _: object = None) -> float:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not abs(value) <= sys.float_info.max:  # an int may be greater, too
        raise wrong("a finite number", value)
    return float(value)


def _exactly(kind: type[T], name: str) -> Callable[[object, object], T]:
    def structure(value: object, _: object) -> T:
        if type(value) is not kind:
            raise wrong(name, value)
        return value

    return structure


def _list(converter: Converter, kind: Any) -> Callable[[object, object], tuple[Any, ...]]:
    inner: Any = list[get_args(kind)[0]]  # type: ignore[misc]

    def structure(value: object, _: object) -> tuple[Any, ...]:
        if not isinstance(value, list):
            raise wrong("a list", value)
        return tuple(converter.structure(value, inner))

    return structure


def _table(converter: Converter, kind: Any, *, closed: bool) -> Callable[[Any, Any], Any]:
    inner: Any
    if is_dataclass(kind):
        wanted = f"a table with {names_of_fields(kind)}"
        # cattrs itself reads a dataclass's annotations without what is Annotated.
        hints = get_type_hints(kind, include_extras=True)
        hooks: Any = {
            item.name: override(struct_hook=_as(converter, hints[item.name])) for item in fields(kind)
        }
        inner = make_dict_structure_fn(
            cast("type[Any]", kind),
            converter,
            _cattrs_forbid_extra_keys=closed,
            _cattrs_detailed_validation=True,
            **hooks,
        )
    else:
        wanted = "a table"
        inner = make_mapping_structure_fn(kind, converter, dict, detailed_validation=True)

    def structure(value: object, to: object) -> Any:
        if not isinstance(value, Mapping):
            raise wrong(wanted, value)
        return inner(value, to)

    return structure


def _as(converter: Converter, kind: Any) -> Callable[[object, object], Any]:
    return lambda value, _: converter.structure(value, kind)


def _narrowed(converter: Converter, kind: Any) -> Callable[[object, object], Any]:
    inner, *limits = get_args(kind)

    def structure(value: object, _: object) -> Any:
        result = converter.structure(value, inner)
        for limit in limits:
            if expected := limit.check(result):
                raise wrong(expected, value)
        return result

    return structure


def _literal(kind: Any) -> Callable[[object, object], Any]:
    names = get_args(kind)

    def structure(value: object, _: object) -> object:
        if not isinstance(value, str) or value not in names:
            raise wrong(f"one of {', '.join(names)}", value)
        return value

    return structure


def _either(converter: Converter, kind: Any) -> Callable[[object, object], Any]:
    """Return what structures a union: of tables the one that has all fields, else the first that fits."""
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
            f"a table with {names_of_fields(one)}" if one in tables else _WORDS.get(one, "a list")
            for one in kinds
        )
        raise wrong(" or ".join(words), value)

    return structure


def _plain(converter: Converter, kind: Any) -> Callable[[Any], dict[str, Any]]:
    """Return what turns a dataclass into plain data, without fields whose value and default are None."""
    optional = {item.name for item in fields(kind) if item.default is None}
    whole = make_dict_unstructure_fn(cast("type[Any]", kind), converter)

    def unstructure(data: Any) -> dict[str, Any]:
        values = whole(data).items()  # cattrs itself would move what may be left out to the end
        return {name: value for name, value in values if value is not None or name not in optional}

    return unstructure


def _converter(*, closed: bool) -> Converter:
    converter = Converter()
    for kind, hook in _HOOKS.items():
        converter.register_structure_hook(kind, hook)
    factories: tuple[tuple[Callable[[Any], bool], Callable[[Any], Any]], ...] = (
        (lambda kind: get_origin(kind) is tuple, lambda kind: _list(converter, kind)),
        (
            lambda kind: get_origin(kind) in (dict, Mapping) or is_dataclass(kind),
            lambda kind: _table(converter, kind, closed=closed),
        ),
        (lambda kind: get_origin(kind) is Annotated, lambda kind: _narrowed(converter, kind)),
        (lambda kind: get_origin(kind) is Literal, _literal),
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
OPEN, CLOSED = _converter(closed=False), _converter(closed=True)
