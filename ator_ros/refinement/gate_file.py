"""The gate as a JSON file, written by `gate` and read by the refinement node."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ator_ros.files import UnreadableError, read_json, write_text
from ator_ros.refinement.errors import RefinementError
from ator_ros.refinement.gate import FEATURES, Gate, OpenGate, ThresholdGate, TreeGate

SCHEMA = "ator_ros/gate"
VERSION = 1
LABELS = ("Higher", "Equal", "Lower")


def save_gate(
    path: Path,
    gate: OpenGate | ThresholdGate | TreeGate,
    training: Mapping[str, Any],
    action_set: str = "default",
) -> None:
    """Write a gate of an action set, with how it was trained, to `path`; atomic."""
    data = {
        "schema": SCHEMA,
        "version": VERSION,
        "action_set": action_set,
        "kind": gate.kind,
        "gate": asdict(gate),
        "training": dict(training),
    }
    write_text(path, json.dumps(data, indent=1) + "\n")


def load_gate(path: Path, action_set: str = "default") -> Gate:
    """Read the gate of an action set.

    Raises
    ------
    RefinementError
        The file cannot be read, is no gate, is newer than this code, or was learned for other actions; the
        message names file and field.
    """
    try:
        data = read_json(path)
    except UnreadableError as error:
        raise RefinementError(str(error)) from error
    if not isinstance(data, dict) or data.get("schema") != SCHEMA:
        raise RefinementError(f"{path}: schema: expected {SCHEMA!r}, got another kind of file")
    if data.get("version") != VERSION:
        raise RefinementError(f"{path}: version: expected {VERSION}, got {str(data.get('version'))[:80]}")
    if data.get("action_set") != action_set:
        raise RefinementError(
            f"{path}: action_set: expected {action_set!r}, got {str(data.get('action_set'))[:80]!r}: "
            "learn the gate of these actions with the tool gate"
        )
    gate = data.get("gate")
    if not isinstance(gate, dict):
        raise RefinementError(f"{path}: gate: expected an object, got {type(gate).__name__}")
    kind = data.get("kind")
    if kind == OpenGate.kind:
        return OpenGate()
    if kind == ThresholdGate.kind:
        return ThresholdGate(_number(path, gate, "gain"), _number(path, gate, "spread_factor"))
    if kind == TreeGate.kind:
        return _tree(path, gate)
    raise RefinementError(f"{path}: kind: expected open, threshold or tree, got {str(kind)[:80]!r}")


def _number(path: Path, data: Mapping[str, Any], name: str) -> float:
    value = data.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise RefinementError(f"{path}: gate.{name}: expected a finite number, got {repr(value)[:80]}")
    return float(value)


def _tree(path: Path, data: Mapping[str, Any]) -> TreeGate:
    names = ("feature", "threshold", "left", "right", "label")
    columns: list[Any] = [data.get(name) for name in names]
    lengths = {len(column) if isinstance(column, list) else -1 for column in columns}
    if len(lengths) != 1 or min(lengths) < 1:
        raise RefinementError(f"{path}: gate: expected lists of one length for {', '.join(names)}")
    nodes = list(zip(*columns, strict=True))
    for index, (feature, threshold, left, right, label) in enumerate(nodes):
        inner = isinstance(feature, str) and feature in FEATURES
        inner = inner and isinstance(threshold, int | float) and math.isfinite(threshold)
        # Children come after their parent, so that no tree can send the reader in circles.
        inner = inner and all(type(child) is int and index < child < len(nodes) for child in (left, right))
        if label not in LABELS or not (inner or feature == ""):
            raise RefinementError(
                f"{path}: gate: node {index}: expected a split on {sorted(FEATURES)} or a leaf"
            )
    return TreeGate(*(tuple(column) for column in columns))
