"""Types for argparse: numbers, and files that can be written."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable
from pathlib import Path

from ator_ros.files import reserved

_NAMESPACE = re.compile(r"(?!__)[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)
_FRAME = re.compile(r"[A-Za-z0-9_][\w.-]*(/[\w.-]+)*", re.ASCII)
_LONGEST_NAME = 100  # characters; names become names of files, which may have 255 bytes
_ROOM = 100_000  # bytes of a result whose size is not known beforehand


def finite(text: str) -> float:
    """Read a finite number; a type for argparse."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"expected a finite number, got {text!r}")
    return value


def number(text: str) -> float:
    """Read a finite number from 0; a type for argparse."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 <= value < math.inf:
        raise argparse.ArgumentTypeError(f"expected a finite number from 0, got {text!r}")
    return value


def jobs(text: str) -> int:
    """Read a number of worker processes, -1 for one per core; a type for argparse."""
    if text == "-1":
        return -1
    try:
        return whole(1)(text)
    except argparse.ArgumentTypeError as error:
        raise argparse.ArgumentTypeError(f"{error}; or -1, one per core") from error


def destination(text: str) -> Path:
    """Read the path of a file that, as far as known beforehand, can be written; a type for argparse."""
    path = Path(text)
    folder = next(parent for parent in path.absolute().parents if parent.exists())
    wanted = f"expected a file that can be written, got {text!r}"
    if path.is_dir() or not folder.is_dir():
        raise argparse.ArgumentTypeError(wanted)
    try:
        with reserved(folder, _ROOM):
            return path
    except OSError as error:
        raise argparse.ArgumentTypeError(f"{wanted}: {error}") from error


def whole(least: int = 0, most: int | None = None) -> Callable[[str], int]:
    """Return a type for argparse: a whole number from `least`, and up to `most` if that is given."""
    expected = f"a whole number from {least}" + (f" to {most}" if most is not None else "")

    def read(text: str) -> int:
        number = int(text) if text.isdecimal() else least - 1
        if number < least or (most is not None and number > most):
            raise argparse.ArgumentTypeError(f"expected {expected}, got {text!r}")
        return number

    return read


def namespace(text: str) -> str:
    """Read a ROS namespace, with or without the / before it, which is left out; a type for argparse."""
    name = text.removeprefix("/")
    if len(name) > _LONGEST_NAME or not _NAMESPACE.fullmatch(name):
        raise argparse.ArgumentTypeError(
            f"expected a namespace of at most {_LONGEST_NAME} letters, digits, _ and /, got {text[:80]!r}"
        )
    return name


def topic(text: str) -> str:
    """Read the name of a topic, with or without the / before it, as an absolute one; a type for argparse."""
    name = text.removeprefix("/")
    if len(name) > _LONGEST_NAME or not _NAMESPACE.fullmatch(name):
        raise argparse.ArgumentTypeError(f"expected the name of a topic, got {text[:80]!r}")
    return f"/{name}"


def frame(text: str) -> str:
    """Read the name of a frame, with or without a / before it, which is left out; a type for argparse."""
    from ator_ros.world.messages import plain_frame  # imports numpy, which no help needs

    name = plain_frame(text)
    if len(name) > _LONGEST_NAME or not _FRAME.fullmatch(name):
        raise argparse.ArgumentTypeError(f"expected the name of a frame, got {text[:80]!r}")
    return name
