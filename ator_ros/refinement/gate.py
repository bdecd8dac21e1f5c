"""The gate: refine only where it is expected to pay (paper, section 5, "after filtering")."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ator_ros.actions import DEFAULT_SET
from ator_ros.files import FileError, load, save
from ator_ros.printable import quoted
from ator_ros.refinement.chain_prediction import ChainPrediction


def gain_and_spread(before: ChainPrediction, after: ChainPrediction) -> tuple[float, float]:
    """Return the predicted gain in s, and the spread in s of the difference of the two predictions."""
    return before.cost - after.cost, math.hypot(before.spread, after.spread)


@dataclass(frozen=True, slots=True)
class Gate:
    """Refines where the predicted gain exceeds a threshold that grows with the models' spread.

    Attributes
    ----------
    gain : float
        Least predicted gain in s.
    spread_factor : float
        Added to it per second of spread.
    """

    gain: float
    spread_factor: float = 0.0

    def needed(self, spread: Any) -> Any:
        """Return the threshold in s at a spread in s, elementwise; the spread may be infinite."""
        return self.gain + self.spread_factor * spread if self.spread_factor else self.gain

    def decide(self, gain: float, spread: float) -> tuple[bool, str]:
        """Return whether a predicted gain in s exceeds the threshold at a spread in s, and why in words."""
        needed = float(self.needed(spread))
        if not (gain > needed or gain >= 0.005):
            return False, "no gain predicted"
        if self == NO_GATE:
            return True, f"predicted gain {gain:.2f} s"
        relation = "is above" if gain > needed else "is not above"
        digits = 2 if f"{gain:.2f}" != f"{needed:.2f}" else 4
        reason = f"predicted gain {gain:.{digits}f} s {relation} the gate's {needed:.{digits}f} s"
        return gain > needed, reason

    def __str__(self) -> str:
        """Return the threshold in words."""
        factor = self.spread_factor
        spread = f" + {factor:g} times the spread of the two predictions" if factor else ""
        return f"refines where the predicted gain is above {self.gain:.2f} s{spread}"


NO_GATE = Gate(0.0)
"""Refines wherever a gain is predicted."""
CAUTIOUS = Gate(0.05, 0.25)
"""The gate of models with which no chain was executed yet: a control tick, and a quarter of the spread."""


# The file

KIND = "gate"
GATE = "gate.json"
"""Name of the file beside the models."""


@dataclass(frozen=True)
class _GateFile:
    """The fields of a gate's file."""

    action_set: str
    gate: Gate
    training: dict[str, Any] = field(default_factory=dict)


def save_gate(path: Path, gate: Gate, training: Mapping[str, Any], action_set: str = DEFAULT_SET) -> None:
    """Write a gate of an action set, with how it was trained, to `path`; atomic."""
    save(path, KIND, _GateFile(action_set, gate, dict(training)))


def add_cautious_gate(folder: Path, action_set: str, command: str) -> bool:
    """Write `CAUTIOUS` beside the models in `folder` if there is no gate; return whether there was none."""
    missing = not os.path.lexists(folder / GATE)
    if missing:
        save_gate(folder / GATE, CAUTIOUS, {"command": command}, action_set)
    return missing


def load_gate(path: Path, action_set: str = DEFAULT_SET) -> Gate:
    """Read the gate of an action set.

    Raises
    ------
    FileError
        The file cannot be read, is no gate, or was learned for other actions; the message names file and
        field.
    """
    file = load(path, KIND, _GateFile)
    if file.action_set != action_set:
        raise FileError(
            f"{path}: action_set: expected {action_set!r}, got {quoted(file.action_set)}: "
            "learn the gate of these actions with the tool gate"
        )
    return file.gate


def gate_in(folder: Path, action_set: str) -> Gate:
    """Read the gate beside the models of an action set as `load_gate` does; `NO_GATE` if there is none."""
    if os.path.lexists(folder / GATE):  # a link that leads nowhere is no missing gate
        return load_gate(folder / GATE, action_set)
    return NO_GATE
