"""Parameter files: checked before ROS reads them, and the domain that a folder of them names.

As a program it prints that domain, the default of the launch file's `domain`.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ator_ros.files import FileError, read_yaml
from ator_ros.printable import short

_FILE = "executor.yaml"
_LARGEST = 1_000_000  # bytes; ours have some 2 kB, and PyYAML takes seconds for 1 MB
_SETTINGS = "ros__parameters"


class ParameterFileError(ValueError):
    """A parameter file that cannot be used; the message names it."""


def check_parameter_files(words: Sequence[str]) -> None:
    """Check the files that follow ``--params-file``; call this before rclpy reads them.

    rcl waits for ever for a pipe, and ignores a text that holds no parameters.

    Raises
    ------
    ParameterFileError
        One cannot be read, or holds something else than parameters. It may be empty.
    """
    for word, following in itertools.pairwise(words):
        if word != "--params-file":
            continue
        try:
            content = read_yaml(Path(following), largest=_LARGEST)
        except FileError as error:
            raise ParameterFileError(f"--params-file: {error}") from error
        if content is not None and not _holds_parameters(content):
            raise ParameterFileError(
                f"--params-file: {following}: expected a table of nodes, each with {_SETTINGS}, "
                f"got {short(content)}"
            )


def _holds_parameters(content: Any) -> bool:
    """Return whether each branch of nested tables, which are namespaces and nodes, leads to parameters."""
    if not isinstance(content, Mapping) or not content:
        return False
    return _SETTINGS in content or all(map(_holds_parameters, content.values()))


def configured_domain(folder: Path) -> str:
    """Return the domain that the executor's file in `folder` names.

    It is empty where the file names none, or cannot be read: the node that reads it reports why.
    """
    try:
        content = read_yaml(folder / _FILE, largest=_LARGEST)
    except FileError:
        return ""
    nodes = content.values() if isinstance(content, Mapping) else ()
    settings = (node.get(_SETTINGS) for node in nodes if isinstance(node, Mapping))
    named = [found.get("domain") for found in settings if isinstance(found, Mapping)]
    return next((name for name in named if isinstance(name, str) and name), "")


if __name__ == "__main__":
    sys.stdout.write(configured_domain(Path(sys.argv[1])))  # an end of line would be in the name
