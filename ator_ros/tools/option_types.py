"""Types for argparse: numbers, and files that can be written."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from pathlib import Path

from ator_ros.files import reserved

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
