"""The calibration as a JSON file: `calibrate_predictions` writes it, refinement node and executor read it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

from ator_ros.files import load, save
from ator_ros.refinement.calibration import TERMS, Calibration, Shortfall
from ator_ros.refinement.errors import RefinementError
from ator_ros.schema import AtMost, Name, OneOf, Within

KIND = "calibration"
CALIBRATION = "calibration.json"
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

    # More than any domain has.
    shortfalls: Annotated[dict[Annotated[str, Name()], _Shortfall], AtMost(100)]


def save_calibration(path: Path, calibration: Calibration, training: Mapping[str, Any]) -> None:
    """Write a calibration, with how it was learned, to `path`; atomic."""
    data = {
        "shortfalls": {action: asdict(shortfall) for action, shortfall in calibration.shortfalls.items()},
        "training": dict(training),
    }
    save(path, KIND, data)


def load_calibration(path: Path) -> Calibration:
    """Read a calibration.

    Raises
    ------
    RefinementError
        The file cannot be read or is no calibration; the message names file and field.
    """
    file = load(path, KIND, _CalibrationFile, error=RefinementError)
    return Calibration({name: Shortfall(**vars(item)) for name, item in file.shortfalls.items()})


def load_calibration_if_any(folder: Path) -> Calibration:
    """Read the calibration in `folder`; without one, predictions stay as they are.

    Raises
    ------
    RefinementError
        As in `load_calibration`.
    """
    path = folder / CALIBRATION
    return load_calibration(path) if os.path.lexists(path) else Calibration()
