"""Values for the launch file: the configured domain, and a robot's URDF.

python3 -m ator_ros.start commands.launch domain CONFIG_FOLDER
python3 -m ator_ros.start commands.launch urdf ROBOT_FILE
"""

from __future__ import annotations

import sys
from pathlib import Path

from ator_ros.bases.description import ConfigError, load_robot
from ator_ros.files import FileError, read_yaml
from ator_ros.simulation.urdf import robot_urdf

_LARGEST = 1_000_000  # bytes; shipped files have some 2 kB


def configured_domain(folder: str) -> str:
    """Return the domain in the executor's file in `folder`.

    Empty without one, or if nodes report a fault.
    """
    try:
        content = read_yaml(Path(folder) / "executor.yaml", largest=_LARGEST)
        named = (node["ros__parameters"].get("domain") for node in content.values())
        return str(next(filter(None, named), ""))
    except (FileError, AttributeError, KeyError, TypeError):
        return ""


def urdf(file: str) -> str:
    """Return the URDF of the robot that a file describes.

    End with one line if it cannot be used.
    """
    try:
        return robot_urdf(load_robot(file))
    except ConfigError as error:
        sys.exit(f"launch: {error}")


def main() -> None:
    """Print a value without a newline."""
    _, name, argument = sys.argv
    sys.stdout.write(urdf(argument) if name == "urdf" else configured_domain(argument))
