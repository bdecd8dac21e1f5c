"""Files as typed classes: cattrs structures what a parser read, strictly, and says where it does not fit.

A schema is a dataclass. Its annotations say what each field must be: numbers are finite, nothing is converted
silently (no "3" for 3, no true for 1), a union is the first of its types that fits, and `Within` and `OneOf`
narrow further. Fields without a default are required. A schema's own ``__post_init__`` raises ValueError for
what fields can't say alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from cattrs import ClassValidationError, Converter, IterableValidationError
from cattrs.errors import ForbiddenExtraKeysError
from cattrs.gen import make_dict_structure_fn, make_mapping_structure_fn, override

T = TypeVar("T")
Data = dict[str, Any]
_LONGEST = 200


class SchemaError(ValueError):
    """Data that does not fit its schema; the message is one line: field, what was expected, what came."""


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
class Format:
    """What a file says about itself, and which versions of it are read.

    Attributes
    ----------
    name : str
        Name of the format.
    version : int
        The version that is written; versions 1 to `version` are read.
    kind : str
        What the file is, for the message to somebody who named another file.
    name_key, version_key : str
        Where a file holds them. Files of before `format` and `schema_version` keep their own words.
    upgrades : mapping of int to callable
        Turns the data of a version into those of the next one.
    """

    name: str
    version: int
    kind: str
    name_key: str = "format"
    version_key: str = "schema_version"
    upgrades: Mapping[int, Callable[[Data], Data]] = field(default_factory=dict)

    def head(self) -> Data:
        """Return the first fields of a file."""
        return {self.name_key: self.name, self.version_key: self.version}

    def current(self, data: object) -> Data:
        """Return the data of a file of any readable version as data of the current one.

        Raises
        ------
        SchemaError
            It is a file of another format, or newer than this program.
        """
        if not isinstance(data, dict) or data.get(self.name_key) != self.name:
            raise SchemaError(f"{self.name_key}: expected {self.name!r}: this is no {self.kind} of ator_ros")
        version = data.get(self.version_key)
        if type(version) is not int or not 1 <= version <= self.version:
            raise SchemaError(
                f"{self.version_key}: expected 1 to {self.version}, got {short(version)}; "
                "a newer one needs a newer ator_ros"
            )
        for number in range(version, self.version):
            data = self.upgrades[number](data)
        return data


def structured(data: object, schema: type[T], where: str = "", *, closed: bool = False) -> T:
    """Return `data` as an instance of `schema`.

    Parameters
    ----------
    data : object
        What a parser read.
    schema : type
        A dataclass, or a type built of them.
    where : str
        Path of `data` in its file, for messages.
    closed : bool
        Whether fields that the schema lacks are refused; otherwise they are left out.

    Raises
    ------
    SchemaError
        It does not fit; the message names the first field that does not.
    """
    try:
        return (_CLOSED if closed else _OPEN).structure(data, schema)
    except Exception as error:  # cattrs raises groups, schemas raise ValueError
        path, text = next(_problems(error, where))
        raise SchemaError(f"{short_path(path)}: {text}" if path else text) from error


def short(value: object) -> str:
    """Return `value` as it is shown in a message."""
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[:80]} … {text[-80:]}"


def short_path(path: str) -> str:
    """Return a path into a file as it is shown in a message."""
    return path if len(path) <= _LONGEST else f"{path[:80]} … {path[-80:]}"


def wrong(expected: str, value: object) -> ValueError:
    """Return the error of a value that is not what was expected."""
    return ValueError(f"expected {expected}; got {short(value)}")


def require(holds: bool, name: str, expected: str, value: object) -> None:
    """Raise ValueError about the field `name` unless something holds; for a schema's ``__post_init__``."""
    if not holds:
        raise ValueError(f"{name}: expected {expected}; got {short(value)}")


def _problems(error: BaseException, path: str) -> Iterator[tuple[str, str]]:
    """Find the single errors in what cattrs raised, each with its path in the file."""
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
            yield path, f"expected the fields {_names(error.cl)}; {short_path(' and '.join(found))}"
    elif isinstance(error, IterableValidationError):
        for inner, item in error.group_exceptions()[0]:
            place = f"[{item.index}]" if isinstance(item.index, int) else f".{item.index}"
            yield from _problems(inner, path + place)
    else:
        yield path, str(error)


def _names(schema: Any) -> str:
    return ", ".join(sorted(item.name for item in fields(schema)))


def _number(value: object, _: object = None) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
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
        wanted = f"a table with {_names(kind)}"
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
        names = (f"a table with {_names(kind)}" if kind in tables else _WORDS[kind] for kind in kinds)
        raise wrong(" or ".join(names), value)

    return structure


def _converter(*, closed: bool) -> Converter:
    converter = Converter()
    for kind, hook in _HOOKS.items():
        converter.register_structure_hook(kind, hook)
    factories: tuple[tuple[Callable[[Any], bool], Callable[[Any], Any]], ...] = (
        (lambda kind: get_origin(kind) is tuple, lambda kind: _list(converter, kind)),
        (
            lambda kind: get_origin(kind) is dict or is_dataclass(kind),
            lambda kind: _table(converter, kind, closed=closed),
        ),
        (lambda kind: get_origin(kind) is Annotated, lambda kind: _narrowed(converter, kind)),
        (lambda kind: get_origin(kind) is Literal, _literal),
        (lambda kind: get_origin(kind) in (Union, UnionType), lambda kind: _either(converter, kind)),
    )
    for applies, factory in factories:
        converter.register_structure_hook_factory(applies, factory)
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
_OPEN, _CLOSED = _converter(closed=False), _converter(closed=True)
