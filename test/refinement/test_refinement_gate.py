"""The gate: decisions, rules as text, file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from ator_ros.files import FileError
from ator_ros.refinement.gate import (
    FEATURES,
    NO_GATE,
    ThresholdGate,
    TreeGate,
    load_gate,
    save_gate,
)

SITUATION = dict.fromkeys(FEATURES, 0.0)
TREE = TreeGate(
    ("gain", "distance", "", "", ""),
    (0.2, 1.4, 0.0, 0.0, 0.0),
    (1, 2, -1, -1, -1),
    (4, 3, -1, -1, -1),
    ("Equal", "Equal", "Lower", "Equal", "Higher"),
)


def test_threshold_grows_with_the_spread() -> None:
    gate = ThresholdGate(0.1, spread_factor=1.0)
    assert gate.decide({**SITUATION, "gain": 0.3, "spread": 0.1})[0]
    assert not gate.decide({**SITUATION, "gain": 0.3, "spread": 0.25})[0]


def test_tree_refines_where_it_predicts_higher_and_gives_its_rule() -> None:
    assert TREE.decide({**SITUATION, "gain": 0.3}) == (True, "Higher performance predicted: gain > 0.20")
    pays, reason = TREE.decide({**SITUATION, "gain": 0.1, "distance": 1.0})
    assert not pays
    assert reason == "Lower performance predicted: gain <= 0.20 and distance <= 1.40"


def test_rules_list_every_leaf() -> None:
    assert TREE.rules() == [
        "if gain <= 0.2 and distance <= 1.4 then Lower",
        "if gain <= 0.2 and distance > 1.4 then Equal",
        "if gain > 0.2 then Higher",
    ]


@pytest.mark.parametrize("gate", [NO_GATE, ThresholdGate(0.15, 0.5), TREE])
def test_a_file_restores_the_gate(gate: Any, tmp_path: Path) -> None:
    save_gate(tmp_path / "gate.json", gate, {"seed": 301})
    assert load_gate(tmp_path / "gate.json") == gate
    assert json.loads((tmp_path / "gate.json").read_text())["training"] == {"seed": 301}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"action_set": "bezier"}, "action_set: expected 'default', got 'bezier'"),
        ({"gate": {"gain": "0.1", "spread_factor": 0.0}}, r"gate\.gain: expected a finite number"),
        (
            {
                "kind": "tree",
                "gate": {"feature": ["gain"], "threshold": [], "left": [0], "right": [0], "label": ["Equal"]},
            },
            "gate: expected lists of one length",
        ),
    ],
)
def test_foreign_and_damaged_files_are_rejected(change: dict[str, Any], message: str, tmp_path: Path) -> None:
    path = tmp_path / "gate.json"
    save_gate(path, ThresholdGate(0.1), {})
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(FileError, match=message):
        load_gate(path)


@pytest.mark.parametrize("gate", [NO_GATE, ThresholdGate(0.05)])
@pytest.mark.parametrize("gain", [-0.02, 0.0])
def test_without_a_predicted_gain_the_reason_states_it(gate: Any, gain: float) -> None:
    assert gate.decide({"gain": gain, "spread": 0.1}) == (False, "no gain predicted")
