"""The gate as a JSON file, written by `gate` and read by the refinement node."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any

from ator_ros.actions import DEFAULT_SET
from ator_ros.files import load, save
from ator_ros.printable import short
from ator_ros.refinement.errors import RefinementError
from ator_ros.refinement.gate import FEATURES, Gate, OpenGate, ThresholdGate, TreeGate
from ator_ros.schema import OneOf, SchemaError, Within, structured

KIND = "gate"
GATE = "gate.json"
"""Name of the file beside the models."""
_SHARED = ("widths", "room", "corrected")
"""What all kinds of gate have; a file states what is not as usual."""


@dataclass(frozen=True)
class _GateFile:
    """The fields of a gate's file; gate: those of the gate of this kind, but what all kinds have."""

    action_set: str
    kind: Annotated[str, OneOf((OpenGate.kind, ThresholdGate.kind, TreeGate.kind))]
    gate: dict[str, Any]
    widths: dict[str, Annotated[float, Within(0.0, math.inf)]] = field(default_factory=dict)
    room: Annotated[float, Within(0.0, 10.0)] = 0.0  # m, around a robot of 10 m at most
    corrected: bool = False
    training: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class GateTraining:
    """How a gate was chosen, as the tool `gate` writes it.

    Attributes
    ----------
    seed, situations : int or None
        Of the situations that it was learned from; None where the file does not say.
    cross_validation : mapping of str to mapping
        Measures by name, of every kind of gate that was compared.
    tree_rules : tuple of str
        The rules of the decision tree.
    """

    seed: int | None = None
    situations: int | None = None
    cross_validation: dict[str, dict[str, int | float]] = field(default_factory=dict)
    tree_rules: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Threshold:
    """The numbers of a `ThresholdGate`."""

    gain: float
    spread_factor: float = 0.0


@dataclass(frozen=True)
class _Tree:
    """The columns of a `TreeGate`."""

    feature: tuple[Annotated[str, OneOf(("", *FEATURES))], ...]
    threshold: tuple[float, ...]
    left: tuple[int, ...]
    right: tuple[int, ...]
    label: tuple[Annotated[str, OneOf(("Higher", "Equal", "Lower"))], ...]

    def __post_init__(self) -> None:
        """Check that the columns make a tree."""
        columns = (self.feature, self.threshold, self.left, self.right, self.label)
        if len({len(column) for column in columns}) != 1 or not self.feature:
            raise ValueError("expected lists of one length, at least 1")
        for index, (name, *children) in enumerate(zip(self.feature, self.left, self.right, strict=True)):
            # Children come after their parent, so that no tree can send the reader in circles.
            if name and not all(index < child < len(self.feature) for child in children):
                raise ValueError(f"node {index}: expected children from {index + 1}, got {children}")


def save_gate(
    path: Path,
    gate: OpenGate | ThresholdGate | TreeGate,
    training: Mapping[str, Any],
    action_set: str = DEFAULT_SET,
) -> None:
    """Write a gate of an action set, with how it was trained, to `path`; atomic."""
    fields = asdict(gate)
    shared = {name: fields.pop(name) for name in _SHARED}
    data = {
        "action_set": action_set,
        "kind": gate.kind,
        "gate": fields,
        **{name: value for name, value in shared.items() if value},
        "training": dict(training),
    }
    save(path, KIND, data)


def load_gate(path: Path, action_set: str = DEFAULT_SET) -> Gate:
    """Read the gate of an action set.

    Raises
    ------
    RefinementError
        The file cannot be read, is no gate or was learned for other actions; the
        message names file and field.
    """
    file = load(path, KIND, _GateFile, error=RefinementError)
    try:
        if file.action_set != action_set:
            raise SchemaError(
                f"action_set: expected {action_set!r}, got {short(file.action_set)}: "
                "learn the gate of these actions with the tool gate"
            )
        return dataclasses.replace(_gate(file), **{name: getattr(file, name) for name in _SHARED})
    except SchemaError as error:
        raise RefinementError(f"{path}: {error}") from error


def gate_in(folder: Path, action_set: str, *, otherwise: Gate | None = None) -> Gate:
    """Read the gate beside the models of an action set; where there is none, return `otherwise`.

    Parameters
    ----------
    folder : Path
        Holds the models of the action set.
    action_set : str
        Its name.
    otherwise : Gate, optional
        By default an open gate.

    Raises
    ------
    RefinementError
        As for `load_gate`.
    """
    if os.path.lexists(folder / GATE):  # a link that leads nowhere is no missing gate
        return load_gate(folder / GATE, action_set)
    return OpenGate() if otherwise is None else otherwise


def _gate(file: _GateFile) -> OpenGate | ThresholdGate | TreeGate:
    if file.kind == OpenGate.kind:
        return OpenGate()
    if file.kind == ThresholdGate.kind:
        threshold = structured(file.gate, _Threshold, "gate")
        return ThresholdGate(threshold.gain, threshold.spread_factor)
    tree = structured(file.gate, _Tree, "gate")
    return TreeGate(tree.feature, tree.threshold, tree.left, tree.right, tree.label)


def load_training(path: Path) -> GateTraining:
    """Read how the gate in a file was chosen.

    Raises
    ------
    RefinementError
        As for `load_gate`; or this part of the file does not fit.
    """
    file = load(path, KIND, _GateFile, error=RefinementError)
    try:
        return structured(file.training, GateTraining, "training")
    except SchemaError as error:
        raise RefinementError(f"{path}: {error}") from error
