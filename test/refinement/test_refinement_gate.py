"""The gate: decisions and file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from ator_ros.files import FileError
from ator_ros.refinement.gate import (
    NO_GATE,
    Gate,
    load_gate,
    save_gate,
)


def test_threshold_grows_with_the_spread() -> None:
    gate = Gate(0.1, spread_factor=1.0)
    assert gate.decide(0.3, 0.1)[0]
    assert not gate.decide(0.3, 0.25)[0]


@pytest.mark.parametrize("gate", [NO_GATE, Gate(0.15, 0.5)])
def test_a_file_restores_the_gate(gate: Any, tmp_path: Path) -> None:
    save_gate(tmp_path / "gate.json", gate, {"seed": 301})
    assert load_gate(tmp_path / "gate.json") == gate
    assert json.loads((tmp_path / "gate.json").read_text())["training"] == {"seed": 301}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"action_set": "bezier"}, "action_set: expected 'default', got 'bezier'"),
        ({"gate": {"gain": "0.1", "spread_factor": 0.0}}, r"gate\.gain: expected a finite number"),
    ],
)
def test_foreign_and_damaged_files_are_rejected(change: dict[str, Any], message: str, tmp_path: Path) -> None:
    path = tmp_path / "gate.json"
    save_gate(path, Gate(0.1), {})
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(FileError, match=message):
        load_gate(path)


@pytest.mark.parametrize("gate", [NO_GATE, Gate(0.05)])
@pytest.mark.parametrize("gain", [-0.02, 0.0])
def test_without_a_predicted_gain_the_reason_states_it(gate: Any, gain: float) -> None:
    assert gate.decide(gain, 0.1) == (False, "no gain predicted")
