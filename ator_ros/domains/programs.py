"""Programs of others that a domain's actions need, and actions of others by name."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import entry_points

from ator_ros.actions.specification import ActionFactory
from ator_ros.files import is_name
from ator_ros.printable import printable, quoted
from ator_ros.schema import require

STAND_INS = "ator_ros.stand_ins"
"""Entry points of this group are actions that drive, without ROS, as the action servers of others do."""


class NoStandInError(ValueError):
    """A stand-in that is not installed, or cannot be imported."""


@dataclass(frozen=True, slots=True)
class Program:
    """An executable of an installed ROS package, as `ros2 run PACKAGE EXECUTABLE` starts it.

    Tools that start our nodes start it beside them.
    """

    package: str
    executable: str

    def __post_init__(self) -> None:
        """Check the names."""
        for field in ("package", "executable"):
            name = getattr(self, field)
            require(is_name(name), field, "a name of letters, digits and _", name)


def stand_in(name: str) -> ActionFactory:
    """Return what makes the stand-in of this name.

    Raises
    ------
    NoStandInError
        It is not installed, or cannot be imported.
    """
    found = {entry.name: entry for entry in entry_points(group=STAND_INS)}
    if name not in found:
        raise NoStandInError(
            f"expected an entry point of {STAND_INS}, one of {sorted(found)}, got {quoted(name)}"
        )
    try:
        factory: ActionFactory = found[name].load()
    except Exception as error:  # a module from outside raises anything
        why = printable(f"{type(error).__name__}: {error}", 200)
        raise NoStandInError(f"{name}: expected to import {found[name].value}, got {why}") from error
    return factory
