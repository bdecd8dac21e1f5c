"""YAML files from outside: of limited size, with plain values only, without aliases, each key once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from ator_ros.files import read_text
from ator_ros.printable import printable

# What PyYAML raises on malformed dates, tagged values and deep nesting.
_UNREADABLE = (
    OSError,
    ValueError,
    TypeError,
    AttributeError,
    ArithmeticError,
    RecursionError,
    yaml.YAMLError,
)
_DEEPEST = 100


class UnreadableYamlError(ValueError):
    """A file that holds no plain YAML; the message names it."""


def read_yaml(path: Path, *, largest: int) -> Any:
    """Read a YAML file of at most `largest` bytes.

    Raises
    ------
    UnreadableYamlError
        The file cannot be read, is larger, or is no plain YAML.
    """
    try:
        return yaml.load(read_text(path, largest), Loader=_PlainLoader)  # noqa: S506 (a SafeLoader)
    except _UNREADABLE as error:
        raise UnreadableYamlError(f"{path}: expected a readable YAML file: {_in_one_line(error)}") from error


def _in_one_line(error: Exception) -> str:
    """Return the number of the line and its problem; the text of PyYAML has several lines."""
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        return f"line {error.problem_mark.line + 1}: {printable(error.problem, 200)}"
    return printable(" ".join(str(error).split()), 200)


class _PlainLoader(yaml.SafeLoader):
    """Reads YAML with each key once, without aliases, with which a few lines name billions of values."""

    _depth = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """Refuse an alias."""
        if self.check_event(yaml.AliasEvent):
            event = self.get_event()  # type: ignore[no-untyped-call]
            raise yaml.YAMLError(f"line {event.start_mark.line + 1}: expected no alias, got *{event.anchor}")
        self._depth += 1
        if self._depth > _DEEPEST:  # PyYAML takes seconds until it gives up
            raise yaml.YAMLError(f"expected at most {_DEEPEST} levels of lists and tables, got more")
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Refuse a key that stands twice: PyYAML would take the later value without a word."""
        seen: set[tuple[str, str]] = set()
        for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
            if (key.tag, key.value) in seen:
                line = key.start_mark.line + 1
                raise yaml.YAMLError(f"line {line}: expected each key once, got {printable(key.value)} again")
            seen.add((key.tag, key.value))
        return super().construct_mapping(node, deep)
