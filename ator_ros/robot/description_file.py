"""Reading of the YAML files that describe robots; each error names file, field, expectation and value."""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import make_dataclass
from pathlib import Path
from typing import Any, get_type_hints

from ator_ros.files import FileError, content_if_stated, read_yaml
from ator_ros.schema import SchemaError, structured
from ator_ros.world.scene import Scene

KIND = "robot"
"""A file may state it."""
_LARGEST = 100_000  # bytes of a description; ours has 2 kB


class ConfigError(ValueError):
    """A configuration file that cannot be used; the message names file, field and expectation."""


def read_description(file: Path, kind: type[Any]) -> Any:
    """Read the sections `robot` and `scene` of a file into `kind`, a dataclass with the field `scene`.

    Raises
    ------
    ConfigError
        The file cannot be read, or a field is missing, unknown or out of its range.
    """
    try:
        data = content_if_stated(read_yaml(file, largest=_LARGEST), KIND)
        read = structured(data, _file(kind), closed=True)  # type: ignore[arg-type]  # a class is hashable
    except FileError as error:
        raise ConfigError(str(error)) from error
    except SchemaError as error:
        raise ConfigError(f"{file}: {error}") from error
    try:
        return kind(**_values(read.robot), scene=read.scene)
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}") from error


@functools.cache
def _file(kind: type[Any]) -> type[Any]:
    """Return the schema of a file: the section `robot` has the fields of `kind` without its scene."""
    types = get_type_hints(kind, include_extras=True)
    own = [
        (item.name, types[item.name], dataclasses.field(default=item.default))
        for item in dataclasses.fields(kind)
        if item.name != "scene"
    ]
    return make_dataclass(
        "DescriptionFile", [("robot", make_dataclass("RobotSection", own)), ("scene", Scene)]
    )


def _values(section: Any) -> dict[str, Any]:
    return {item.name: getattr(section, item.name) for item in dataclasses.fields(section)}
