"""The rules of a model tree agree with its predictions."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from ator_ros.performance.tree.nodes import Hinge, ModelTree, RuleWriter, leaves


def small_tree() -> ModelTree:
    """Build dist <= 2.3, below it dist <= 1.86, below its right side angle_to_dest <= 49.7°."""
    return ModelTree(
        names=("dist", "angle_to_dest", "v"),
        feature=np.array([0, 0, 0, 1, 0, 0, 0]),
        threshold=np.array([2.3, 1.86, 0.0, math.radians(49.7), 0.0, 0.0, 0.0]),
        children=np.array([[1, 6], [2, 3], [2, 2], [4, 5], [4, 4], [5, 5], [6, 6]]),
        intercept=np.array([0.0, 0.0, 1.0, 0.0, -0.42, 3.0, 4.0]),
        coefficients=np.array(
            [[0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0], [1.26, 1.031, -0.5], [1, 0, 0], [1, 0, 0]]
        ),
        lower=np.array([0.0, 0.0, 0.5, 0.0, 1.0, 0.0, 3.0]),
        upper=np.array([0.0, 0.0, 2.0, 0.0, 3.5, 9.0, 9.0]),
        spread=np.array([0.0, 0.0, 0.1, 0.0, 0.05, 0.2, 0.3]),
        samples=np.array([100.0, 60.0, 20.0, 40.0, 25.0, 15.0, 40.0]),
    )


WRITER = RuleWriter(small_tree(), {"dist": "m", "angle_to_dest": "rad"})


def test_a_rule_has_the_format_of_the_paper():
    text = WRITER.rule(4, dict(leaves(small_tree()))[4])
    assert text == (
        "if (1.86m < dist <= 2.3m) & (angle_to_dest <= 49.7°) "
        "then time = 1.26*dist + 0.018*angle_to_dest - 0.5*v - 0.42  [s]  (± 0.05 s, 25 samples)"
    )


def test_the_whole_tree_is_one_line_per_leaf_with_redundant_bounds_joined():
    lines = WRITER.rules().splitlines()
    assert lines[0].startswith("if (dist <= 1.86m) then time = 1  [s]")
    assert lines[2].startswith(
        "if (1.86m < dist <= 2.3m) & (angle_to_dest > 49.7°) then time = 1*dist + 3"
    )
    assert lines[3].startswith("if (dist > 2.3m) then time = 1*dist + 4")
    assert len(lines) == 4


BENT = (Hinge("dist", 0.0, 2.0), Hinge("angle_to_dest", math.radians(45.0), 1.0))


def written(**changes: Any) -> list[str]:
    return (
        RuleWriter(dataclasses.replace(small_tree(), **changes), WRITER.units).rules().splitlines()
    )


def test_a_base_with_bends_is_printed_once() -> None:
    first, *rules = written(base=BENT)
    assert first == "shared = 2*dist + 0.0175*max(0, angle_to_dest - 45°)  [s]"
    assert rules[0].startswith("if (dist <= 1.86m) then time = shared + 1  [s]")
    assert "then time = shared + 1.26*dist + 0.018*angle_to_dest - 0.5*v - 0.42  [s]" in rules[1]
    assert len(rules) == 4


def test_a_leaf_that_adds_nothing_to_the_base_is_the_base() -> None:
    tree = small_tree()
    _, first, *_ = written(
        base=BENT, intercept=tree.intercept * (np.arange(len(tree.intercept)) != 2)
    )
    assert first.startswith("if (dist <= 1.86m) then time = shared  [s]")


def test_a_straight_base_is_part_of_each_rule() -> None:
    rules = written(base=BENT[:1])
    assert rules[0].startswith("if (dist <= 1.86m) then time = 2*dist + 1  [s]")
    assert len(rules) == 4


def test_an_explanation_adds_up_and_states_the_bounds():
    explanation = WRITER.explanation(np.array([2.0, 0.5, 0.4])).splitlines()
    assert explanation[1] == "here time = 2.415 ± 0.050 s:"
    parts = [float(line.split()[0]) for line in explanation[2:]]
    assert sum(parts) == pytest.approx(2.415, abs=0.002)
    assert explanation[3].endswith("dist = 2m")
    assert "angle_to_dest = 28.6°" in explanation[4]
    held = WRITER.explanation(np.array([2.0, 0.5, -9.0]))
    assert "here time = 3.500" in held
    assert (
        held.splitlines()[-1].strip()
        == "held within 1.000 to 3.500: 7.115 is beyond the experience"
    )
