"""Reading of the YAML files that describe robots; each error names file, field, expectation and value."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from dataclasses import make_dataclass
from pathlib import Path
from typing import Any, get_type_hints

from ator_ros.formats import Format
from ator_ros.plain_yaml import UnreadableYamlError, read_yaml
from ator_ros.robot.former_form import FormerForm, former_forms
from ator_ros.schema import SchemaError, structured
from ator_ros.world.scene import Scene

FORMAT = Format("ator_ros robot", 1, "description of a robot")
"""A file may state it; one that does not is of version 1, or of the former form without a version."""
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
    shown: Mapping[str, str] = {}
    try:
        data: Any = FORMAT.content_if_stated(read_yaml(file, largest=_LARGEST))
        form = _former_form(data)
        if form is not None:
            shown = form.shown
            names = frozenset(item.name for item in dataclasses.fields(kind) if _needed(item)) - {"scene"}
            structured(data, form.schema(names), closed=True)
            data = form.renamed(data)
        read = structured(data, _file(kind), closed=True)  # type: ignore[arg-type]  # a class is hashable
    except UnreadableYamlError as error:
        raise ConfigError(str(error)) from error
    except SchemaError as error:
        where, colon, what = str(error).partition(": ")
        raise ConfigError(f"{file}: {shown.get(where, where)}{colon}{what}") from error
    try:
        return kind(**_values(read.robot), scene=read.scene)
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}") from error


def _needed(item: dataclasses.Field[Any]) -> bool:
    return item.default is dataclasses.MISSING


def _former_form(data: Any) -> FormerForm | None:
    """Return the former form that the content of a file has, None if it has today's."""
    if not isinstance(data, Mapping) or "scene" in data:
        return None
    return next((form for form in former_forms() if not form.sections.isdisjoint(data)), None)


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
