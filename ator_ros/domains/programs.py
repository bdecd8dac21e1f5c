"""Programs of others that a domain's actions need, and actions of others by name."""

from __future__ import annotations

import shlex
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
    """A program that tools start beside our nodes: an executable of a ROS package, or a command.

    Attributes
    ----------
    package, executable : str
        As `ros2 run PACKAGE EXECUTABLE` starts it.
    command : str or tuple of str
        In place of both: the words of a command. A text is split as a shell does.
    folder : str
        The folder in which the command runs; in a domain's file relative to the file.
    """

    package: str = ""
    executable: str = ""
    command: str | tuple[str, ...] = ()
    folder: str = ""

    def __post_init__(self) -> None:
        """Check that there is either an executable or a command."""
        if self.command:
            alone = not (self.package or self.executable)
            require(alone, "command", "none beside package and executable", self.command)
            try:
                found = bool(self.words)
            except ValueError:  # a quotation that does not end
                found = False
            require(found, "command", "words as in a shell", self.command)
            return
        for field in ("package", "executable"):
            name = getattr(self, field)
            require(is_name(name), field, "a name of letters, digits and _ (or `command`)", name)

    @property
    def words(self) -> list[str]:
        """The words of the command; empty without one."""
        return shlex.split(self.command) if isinstance(self.command, str) else list(self.command)

    @property
    def name(self) -> str:
        """The executable, or the command in one line."""
        return self.executable or shlex.join(self.words)


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
