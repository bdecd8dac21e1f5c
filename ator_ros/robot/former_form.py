"""Forms that robots' files had before. The domain whose words one used still reads it, by an entry point."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Any

GROUP = "ator_ros.former_robot_files"
"""Entry points of this group are a `FormerForm` each."""


@dataclass(frozen=True, slots=True)
class FormerForm:
    """A form that files of robots had before robot and scene were apart.

    Attributes
    ----------
    sections : frozenset of str
        Sections by which such a file is known.
    shown : mapping of str to str
        What such a file calls each of today's fields.
    schema : callable
        Returns the schema of such a file, given the fields of a robot.
    renamed : callable
        Returns the sections `robot` and `scene` of a file that has the schema.
    written : callable
        Returns the content of a description in this form, None where the form cannot say it. Digests are
        taken of it, as they always were, so that models remain those of their robot.
    """

    sections: frozenset[str]
    shown: Mapping[str, str]
    schema: Callable[[frozenset[str]], type[Any]]
    renamed: Callable[[Mapping[str, Any]], dict[str, Any]]
    written: Callable[[Mapping[str, Any]], Mapping[str, Any] | None]


@functools.cache
def former_forms() -> tuple[FormerForm, ...]:
    """Return all forms that are installed."""
    return tuple(entry.load() for entry in entry_points(group=GROUP))
