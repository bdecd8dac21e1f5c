"""The calibration as a JSON file: `calibrate_predictions` writes it, refinement node and executor read it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ator_ros.files import UnreadableError, is_name, read_json, write_text
from ator_ros.refinement.calibration import TERMS, Calibration, Shortfall
from ator_ros.refinement.errors import RefinementError

SCHEMA = "ator_ros/calibration"
VERSION = 1
CALIBRATION = "calibration.json"
_LARGEST = 1e6
_MOST_ACTIONS = 100


def save_calibration(path: Path, calibration: Calibration, training: Mapping[str, Any]) -> None:
    """Write a calibration, with how it was learned, to `path`; atomic."""
    data = {
        "schema": SCHEMA,
        "version": VERSION,
        "shortfalls": {action: asdict(shortfall) for action, shortfall in calibration.shortfalls.items()},
        "training": dict(training),
    }
    write_text(path, json.dumps(data, indent=1) + "\n")


def load_calibration(path: Path) -> Calibration:
    """Read a calibration.

    Raises
    ------
    RefinementError
        The file cannot be read, is no calibration, or is newer than this code; the message names file and
        field.
    """
    try:
        data = read_json(path)
    except UnreadableError as error:
        raise RefinementError(str(error)) from error
    if not isinstance(data, dict) or data.get("schema") != SCHEMA:
        raise RefinementError(f"{path}: schema: expected {SCHEMA!r}, got another kind of file")
    if data.get("version") != VERSION:
        raise RefinementError(f"{path}: version: expected {VERSION}, got {data.get('version')!r}")
    shortfalls = data.get("shortfalls")
    if not isinstance(shortfalls, dict) or len(shortfalls) > _MOST_ACTIONS:
        raise RefinementError(f"{path}: shortfalls: expected an object of at most {_MOST_ACTIONS} actions")
    return Calibration({action: _shortfall(path, action, item) for action, item in shortfalls.items()})


def load_calibration_if_any(folder: Path) -> Calibration:
    """Read the calibration in `folder`; without one, predictions stay as they are.

    Raises
    ------
    RefinementError
        As in `load_calibration`.
    """
    path = folder / CALIBRATION
    return load_calibration(path) if path.exists() else Calibration()


def _shortfall(path: Path, action: str, data: Any) -> Shortfall:
    if not is_name(action):
        raise RefinementError(f"{path}: shortfalls: expected names of actions, got {action[:40]!r}")
    where = f"{path}: shortfalls.{action}"
    if not isinstance(data, dict) or not isinstance(data.get("slopes"), dict):
        raise RefinementError(f"{where}: expected an object with slopes")
    if unknown := sorted(set(data["slopes"]) - set(TERMS)):
        raise RefinementError(f"{where}.slopes: expected terms of {sorted(TERMS)}, got {unknown[0][:40]!r}")
    slopes = {name: _number(f"{where}.slopes.{name}", value) for name, value in data["slopes"].items()}
    constant, low, high = (_number(f"{where}.{name}", data.get(name)) for name in ("constant", "low", "high"))
    model = data.get("model")
    if low > high or not isinstance(model, str):
        raise RefinementError(f"{where}: expected low at most high and the digest of a model")
    return Shortfall(constant, slopes, low, high, model)


def _number(where: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise RefinementError(f"{where}: expected a finite number, got {str(value)[:40]!r}")
    if abs(value) > _LARGEST:
        raise RefinementError(f"{where}: expected a number from -{_LARGEST:g} to {_LARGEST:g}, got {value:g}")
    return float(value)
