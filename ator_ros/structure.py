"""Plain data from files, made typed: each error names the field, what was expected, and what came."""

from __future__ import annotations

import dataclasses
import math
import types
from collections.abc import Mapping
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from ator_ros.printable import printable, quoted

T = TypeVar("T")
NAMED = "named"
"""Key in the metadata of a dataclass field whose name in files differs, as that of a keyword must."""
_MOST = 1000
"""Most items of a list or a mapping, and most characters of a text."""
_WORDS: Mapping[type, str] = types.MappingProxyType(
    {str: "a text", float: "a finite number", int: "a whole number", bool: "true or false"}
)


class StructureError(ValueError):
    """Data of another structure; the message names the field, what was expected and what came."""


def structured(kind: type[T], data: Any, where: str = "") -> T:
    """Make an instance of a dataclass of plain data, as a YAML file holds it.

    Parameters
    ----------
    kind : type
        A dataclass of texts, numbers, literals, tuples, mappings and further dataclasses. The text of a
        ValueError that it raises when it is made must begin with the field's name (see `require`).
    data : object
        Plain data.
    where : str
        The place of the data, for messages; empty for a whole file.

    Raises
    ------
    StructureError
        The data has another structure.
    """
    made: T = _made(kind, data, where)
    return made


def _made(kind: Any, data: Any, where: str) -> Any:
    if dataclasses.is_dataclass(kind):
        return _instance(kind, data, where)
    if kind in _WORDS:
        return _scalar(kind, data, where)
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Literal:
        if data not in inner or not isinstance(data, str):
            raise _unlike(where, f"one of {', '.join(inner)}", data)
        return data
    if origin in (Union, types.UnionType):
        return _one_of(inner, data, where)
    if origin is tuple:
        _check_size(list, data, where)
        return tuple(_made(inner[0], item, f"{where}[{number}]") for number, item in enumerate(data))
    _check_size(dict, data, where)
    keys = {_made(inner[0], key, f"{where or 'top level'}: key"): item for key, item in data.items()}
    return {key: _made(inner[1], item, _within(where, str(key))) for key, item in keys.items()}


def _instance(kind: Any, data: Any, where: str) -> Any:
    _check_size(dict, data, where)
    fields = {str(item.metadata.get(NAMED, item.name)): item for item in dataclasses.fields(kind)}
    unknown = [key for key in data if key not in fields]
    if unknown:
        raise _unlike(where, f"the fields {', '.join(fields)}", unknown[0])
    missing = [name for name, item in fields.items() if name not in data and _is_required(item)]
    if missing:
        raise StructureError(f"{_within(where, missing[0])}: expected a value, got none")
    types_of = get_type_hints(kind)
    values = {
        fields[key].name: _made(types_of[fields[key].name], value, _within(where, key))
        for key, value in data.items()
    }
    try:
        return kind(**values)
    except StructureError:
        raise
    except ValueError as error:
        raise StructureError(_within(where, str(error))) from error


def _scalar(kind: type, data: Any, where: str) -> Any:
    right = isinstance(data, kind) and (kind is bool or not isinstance(data, bool))
    if kind is float:
        whole = isinstance(data, int) and not isinstance(data, bool)
        right = (right or whole) and _is_finite(data)
    if not right or (kind is str and len(data) > _MOST):
        raise _unlike(where, _WORDS[kind], data)
    return float(data) if kind is float else data


def _is_finite(number: float) -> bool:
    try:
        return math.isfinite(number)
    except OverflowError:  # a whole number that no float holds
        return False


def _one_of(kinds: tuple[Any, ...], data: Any, where: str) -> Any:
    """Return the data as the first kind that it suits; a kind that is no scalar comes last and alone."""
    if data is None and types.NoneType in kinds:
        return None
    left = [kind for kind in kinds if kind is not types.NoneType]
    if len(left) == 1:
        return _made(left[0], data, where)
    for kind in left:
        try:
            return _made(kind, data, where)
        except StructureError:
            continue
    raise _unlike(where, " or ".join(_WORDS.get(kind, str(kind)) for kind in left), data)


def _is_required(item: dataclasses.Field[Any]) -> bool:
    return item.default is dataclasses.MISSING and item.default_factory is dataclasses.MISSING


def _check_size(kind: type, data: Any, where: str) -> None:
    what = "a list" if kind is list else "a mapping"
    if not isinstance(data, kind):
        raise _unlike(where, what, data)
    if len(data) > _MOST:  # type: ignore[arg-type]
        raise StructureError(f"{where or 'top level'}: expected at most {_MOST} items, got more")


def _within(where: str, name: str) -> str:
    shown = printable(name, _MOST)
    return f"{where}.{shown}" if where else shown


def _unlike(where: str, expected: str, data: Any) -> StructureError:
    return StructureError(f"{where or 'top level'}: expected {expected}, got {quoted(data)}")


def require(holds: bool, field: str, expected: str, got: object) -> None:
    """Raise ValueError about a field unless something holds; for the `__post_init__` of a dataclass."""
    if not holds:
        raise ValueError(f"{field}: expected {expected}, got {quoted(got)}")
