"""The calibration as a JSON file: `calibrate_predictions` writes it, refinement node and executor read it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

from ator_ros.files import UnreadableError, is_name, read_json, write_text
from ator_ros.formats import Format
from ator_ros.printable import short
from ator_ros.refinement.calibration import TERMS, Calibration, Shortfall
from ator_ros.refinement.errors import RefinementError
from ator_ros.schema import OneOf, SchemaError, Within, structured

FORMAT = Format("ator_ros calibration", 1, "calibration")
CALIBRATION = "calibration.json"
_MOST_ACTIONS = 100
"""More than any domain has; each is structured before it is used."""
_Seconds = Annotated[float, Within(-1e6, 1e6)]
"""Eleven days, longer than any action; sums of such numbers keep a resolution of 1 ns."""


@dataclass(frozen=True)
class _Shortfall:
    """The fields of a `Shortfall`."""

    constant: _Seconds
    slopes: dict[Annotated[str, OneOf(TERMS)], _Seconds]
    low: _Seconds
    high: _Seconds
    model: str

    def __post_init__(self) -> None:
        """Check the bounds of a correction."""
        if self.low > self.high:
            raise ValueError(f"expected low at most high, got {self.low:g} and {self.high:g}")


@dataclass(frozen=True)
class _CalibrationFile:
    """The fields of a calibration's file; shortfalls: by the name of the action."""

    shortfalls: dict[str, _Shortfall]


def save_calibration(path: Path, calibration: Calibration, training: Mapping[str, Any]) -> None:
    """Write a calibration, with how it was learned, to `path`; atomic."""
    data = {
        "shortfalls": {action: asdict(shortfall) for action, shortfall in calibration.shortfalls.items()},
        "training": dict(training),
    }
    write_text(path, FORMAT.text(data))


def load_calibration(path: Path) -> Calibration:
    """Read a calibration.

    Raises
    ------
    RefinementError
        The file cannot be read, is no calibration, or is newer than this code; the message names file and
        field.
    """
    try:
        data = FORMAT.current(read_json(path))
        _check_names(data.get("shortfalls"))  # before anything is built of them
        file = structured(data, _CalibrationFile)
    except UnreadableError as error:
        raise RefinementError(str(error)) from error
    except SchemaError as error:
        raise RefinementError(f"{path}: {error}") from error
    return Calibration({name: Shortfall(**vars(item)) for name, item in file.shortfalls.items()})


def _check_names(actions: object) -> None:
    if isinstance(actions, dict) and len(actions) > _MOST_ACTIONS:
        raise SchemaError(f"shortfalls: expected at most {_MOST_ACTIONS} actions, got {len(actions)}")
    for action in actions if isinstance(actions, dict) else ():
        if not is_name(action):
            raise SchemaError(f"shortfalls: expected names of actions, got {short(action)}")


def load_calibration_if_any(folder: Path) -> Calibration:
    """Read the calibration in `folder`; without one, predictions stay as they are.

    Raises
    ------
    RefinementError
        As in `load_calibration`.
    """
    path = folder / CALIBRATION
    return load_calibration(path) if os.path.lexists(path) else Calibration()
