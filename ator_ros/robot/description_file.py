"""Reading of YAML files into dataclasses; each error names file, field, expectation and value."""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Mapping
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from ator_ros import plain_yaml

T = TypeVar("T")
_LARGEST = 100_000  # bytes of a description; ours has 2 kB
# Plausible ranges: learned features, tables of turns and the physics rely on them.
_LENGTH = (0.001, 10.0)
_PLACE = (-1000.0, 1000.0)
_BOUNDS: dict[str, tuple[float, float]] = {
    **dict.fromkeys(("mass", "wheel_torque"), (0.001, 10_000.0)),
    "motor_time_constant": (0.0001, 10.0),
    "v": (0.01, 5.0),  # tables of turns grow with it
    "w": (0.01, 50.0),
    **dict.fromkeys(("a", "brake"), (0.01, 100.0)),
    "aw": (0.01, 1000.0),
    "rolling_deceleration": (0.001, 100.0),
    "restitution": (0.0001, 1.0),
    **dict.fromkeys(("x", "y"), _PLACE),
    "yaw": (-math.tau, math.tau),
}
_WIDE = (0.001, 1000.0)
_BOUNDS_IN: dict[str, dict[str, tuple[float, float]]] = {
    "Area": dict.fromkeys(("length", "width", "margin"), _WIDE),
    "Bay": dict.fromkeys(("width", "depth"), _WIDE),
}
_MOST = 100
"""Most objects or bays of a scene."""


class ConfigError(ValueError):
    """A configuration file that cannot be used; the message names file, field and expectation."""


def read_yaml(file: Path) -> Any:
    """Read a YAML file without aliases.

    Raises
    ------
    ConfigError
        The file cannot be read.
    """
    try:
        return plain_yaml.read_yaml(file, largest=_LARGEST)
    except plain_yaml.UnreadableYamlError as error:
        raise ConfigError(str(error)) from error


class Structure:
    """Makes dataclasses of the mappings, lists and numbers of a file.

    Parameters
    ----------
    file : Path
        The file, for messages.
    shown : mapping of str to str
        What the file calls a field, by its path, where that differs.
    """

    def __init__(self, file: Path, shown: Mapping[str, str]) -> None:
        self._file, self._shown = file, shown

    def section(
        self, data: Any, where: str, expected: set[str], optional: frozenset[str]
    ) -> Mapping[str, Any]:
        """Return `data` if it is a mapping with the expected fields; raises ConfigError."""
        if not isinstance(data, Mapping):
            raise self._error(where, f"expected a mapping, got {type(data).__name__}")
        wrong = (set(data) ^ expected) - (optional & expected)
        if wrong:
            names = sorted(expected - optional)
            more = f" and perhaps {sorted(optional)}" if optional else ""
            raise self._error(
                where,
                f"expected the fields {names}{more}; "
                f"missing or unknown: {_short(sorted(str(key) for key in wrong))}",
            )
        return data

    def build(self, kind: type[T], data: Any, where: str, **given: Any) -> T:
        """Make a dataclass of the mapping `data` and of what is `given`; raises ConfigError."""
        fields = [
            item
            for item in dataclasses.fields(kind)  # type: ignore[arg-type]
            if item.name not in given
        ]
        optional = frozenset(item.name for item in fields if _has_default(item))
        section = self.section(data, where, {item.name for item in fields}, optional)
        types, bounds = get_type_hints(kind), _BOUNDS | _BOUNDS_IN.get(kind.__name__, {})
        values = {
            item.name: self._value(
                types[item.name],
                section[item.name],
                f"{where}.{item.name}",
                bounds.get(item.name, _LENGTH),
            )
            for item in fields
            if item.name in section
        }
        return kind(**values, **given)

    def _value(self, kind: Any, value: Any, where: str, bounds: tuple[float, float]) -> Any:
        origin, parts = get_origin(kind), get_args(kind)
        if origin is UnionType:
            rest = next(part for part in parts if part is not NoneType)
            return None if value is None else self._value(rest, value, where, bounds)
        if origin is tuple:
            entries = self._few(value, list, where)
            return tuple(self.build(parts[0], entry, f"{where}[{i}]") for i, entry in enumerate(entries))
        if origin is not None:
            entries = self._few(value, Mapping, where)
            return {
                self._name(key, where): self.build(parts[1], entries[key], f"{where}.{key}")
                for key in entries
            }
        if kind is str:
            if not isinstance(value, str):
                raise self._error(where, f"expected a text, got {_short(value)}")
            return value
        return self._number(value, where, *bounds) if kind is float else self.build(kind, value, where)

    def _few(self, value: Any, kind: type, where: str) -> Any:
        if not isinstance(value, kind) or len(value) > _MOST:  # type: ignore[arg-type]
            name = "list" if kind is list else "mapping"
            raise self._error(where, f"expected a {name} of at most {_MOST} entries, got {_short(value)}")
        return value

    def _name(self, name: Any, where: str) -> str:
        if not (isinstance(name, str) and name.isascii() and name.isidentifier()):
            raise self._error(where, f"expected names of letters, digits and _, got {_short(name)}")
        return name

    def _number(self, value: Any, where: str, low: float, high: float) -> float:
        number = isinstance(value, int | float) and not isinstance(value, bool)
        signed = low < 0.0
        if not number or not (-sys.float_info.max if signed else 0.0) <= value <= sys.float_info.max:
            raise self._error(where, f"expected a {'' if signed else 'positive '}number, got {_short(value)}")
        if not (signed or value):
            raise self._error(where, f"expected a positive number, got {_short(value)}")
        if not low <= value <= high:
            raise self._error(where, f"expected a number from {low:g} to {high:g}, got {value:g}")
        return float(value)

    def _error(self, where: str, what: str) -> ConfigError:
        return ConfigError(f"{self._file}: {self._shown.get(where, where) or 'top level'}: {what}")


def _has_default(item: dataclasses.Field[Any]) -> bool:
    return item.default is not dataclasses.MISSING or item.default_factory is not dataclasses.MISSING


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 200 else f"{text[:200]}..."
