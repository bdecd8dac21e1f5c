"""Formats of files: name and version, as files state them."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ator_ros.printable import short
from ator_ros.schema import SchemaError

Data = dict[str, Any]


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
    name_key, version_key : str
        Keys of both in a file; older files keep their own keys.
    upgrades : mapping of int to callable
        Turns the data of a version into those of the next one.
    unversioned : bool
        Whether files without these fields are read as version 1: those from before they had them.
    """

    name: str
    version: int
    kind: str
    name_key: str = "format"
    version_key: str = "schema_version"
    upgrades: Mapping[int, Callable[[Data], Data]] = field(default_factory=dict)
    unversioned: bool = False

    def head(self) -> Data:
        """Return the first fields of a file."""
        return {self.name_key: self.name, self.version_key: self.version}

    def text(self, data: Mapping[str, Any]) -> str:
        """Return a JSON file with these data."""
        return json.dumps({**self.head(), **data}, indent=1) + "\n"

    def current(self, data: object) -> Data:
        """Return the data of a file of any readable version as data of the current one.

        Raises
        ------
        SchemaError
            It is a file of another format, or newer than this program.
        """
        if self.unversioned and isinstance(data, dict):
            data = {self.name_key: self.name, self.version_key: 1, **data}
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
