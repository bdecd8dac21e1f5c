"""Formats of files: name and version, as every file of ours states them first."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

from ator_ros.printable import short
from ator_ros.schema import SchemaError

Data = dict[str, Any]
_NAME, _VERSION = "format", "schema_version"


@dataclass(frozen=True)
class Format:
    """Name and version that a file states, and the versions that are read.

    Attributes
    ----------
    name : str
        Name of the format.
    version : int
        The version that is written; versions 1 to `version` are read.
    kind : str
        What the file is, for the message about another file.
    upgrades : mapping of int to callable
        Turns the data of a version into those of the next one.
    """

    name: str
    version: int
    kind: str
    upgrades: Mapping[int, Callable[[Data], Data]] = field(default_factory=dict)

    def head(self) -> Data:
        """Return the first fields of a file."""
        return {_NAME: self.name, _VERSION: self.version}

    def text(self, data: Mapping[str, Any], *, compact: Collection[str] = ()) -> str:
        """Return a JSON file with these data; fields named in `compact` take one line each."""
        fields = ",\n".join(
            f" {json.dumps(name)}: {_compact(value) if name in compact else _indented(value)}"
            for name, value in {**self.head(), **data}.items()
        )
        return f"{{\n{fields}\n}}\n"

    def current(self, data: object) -> Data:
        """Return the data of a file of any readable version as data of the current one.

        Raises
        ------
        SchemaError
            It is a file of another format, of a time before the files had this head, or newer than this
            program.
        """
        if not isinstance(data, dict) or data.get(_NAME) != self.name:
            raise SchemaError(f"{_NAME}: expected {self.name!r}: {self._what_came(data)}")
        version = data.get(_VERSION)
        if type(version) is not int or not 1 <= version <= self.version:
            raise SchemaError(
                f"{_VERSION}: expected 1 to {self.version}, got {short(version)}; "
                "a newer one needs a newer ator_ros"
            )
        for number in range(version, self.version):
            data = self.upgrades[number](data)
        return data

    def _what_came(self, data: object) -> str:
        """Describe data of another format."""
        if isinstance(data, dict) and _NAME not in data and "schema" in data:
            return f"a former ator_ros wrote this {self.kind}; make it again"
        return f"this is no {self.kind} of ator_ros"

    def content(self, data: object) -> Data:
        """Return what `current` does, without the first fields."""
        return {name: value for name, value in self.current(data).items() if name not in self.head()}

    def content_if_stated(self, data: object) -> object:
        """Return what `content` does; without format and version, `data` are those of the current version.

        For files that people write, which need not begin with the head.
        """
        stated = isinstance(data, dict) and not data.keys().isdisjoint(self.head())
        return self.content(data) if stated else data


def _indented(value: object) -> str:
    """Return JSON over several lines, as a field of an object."""
    return json.dumps(value, indent=1).replace("\n", "\n ")  # in a string JSON has no line break


def _compact(value: object) -> str:
    return json.dumps(value, separators=(",", ":"))
