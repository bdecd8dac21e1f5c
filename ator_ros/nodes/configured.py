"""Print the domain that a folder of parameter files names: the default of the launch file's `domain`."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

from ator_ros.plain_yaml import UnreadableYamlError, read_yaml

_FILE = "executor.yaml"
_LARGEST = 200_000


def configured_domain(folder: Path) -> str:
    """Return the domain that the executor's file in `folder` names.

    It is empty where the file names none, or cannot be read: the node that reads it reports why.
    """
    try:
        content = read_yaml(folder / _FILE, largest=_LARGEST)
    except UnreadableYamlError:
        return ""
    nodes = content.values() if isinstance(content, Mapping) else ()
    settings = (node.get("ros__parameters") for node in nodes if isinstance(node, Mapping))
    named = [found.get("domain") for found in settings if isinstance(found, Mapping)]
    return next((name for name in named if isinstance(name, str) and name), "")


if __name__ == "__main__":
    sys.stdout.write(configured_domain(Path(sys.argv[1])))  # an end of line would be in the name
