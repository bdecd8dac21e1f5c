"""The rules of a model tree: they say what the tree predicts."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ator_ros.performance.tree.model_tree import ModelTreeRegressor
from ator_ros.performance.tree.nodes import ModelTree, RuleWriter, rule_for, rules

WRITER = RuleWriter({"dist": "m", "angle_to_dest": "rad"})


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


def test_a_rule_reads_as_in_the_paper():
    text = WRITER.rule(rule_for(small_tree(), np.array([2.0, 0.5, 0.0])))
    assert text == (
        "if (1.86m < dist <= 2.3m) & (angle_to_dest <= 49.7°) "
        "then time = 1.26*dist + 0.018*angle_to_dest - 0.5*v - 0.42  [s]  (± 0.05 s, 25 samples)"
    )


def test_the_whole_tree_is_one_line_per_leaf_with_redundant_bounds_joined():
    lines = WRITER.tree(small_tree()).splitlines()
    assert lines[0].startswith("if (dist <= 1.86m) then time = 1  [s]")
    assert lines[2].startswith("if (1.86m < dist <= 2.3m) & (angle_to_dest > 49.7°) then time = 1*dist + 3")
    assert lines[3].startswith("if (dist > 2.3m) then time = 1*dist + 4")
    assert len(lines) == 4


def test_exactly_one_rule_holds_anywhere_and_it_is_the_one_that_predicts():
    rng = np.random.default_rng(1)
    X = rng.uniform(-1, 1, size=(2000, 3))
    y = np.abs(X[:, 0]) + np.maximum(X[:, 1], 0.3) + rng.normal(0, 0.01, 2000)
    tree = ModelTreeRegressor(extrapolation=None).fit(X, y).tree_
    every = list(rules(tree))
    assert len(every) == tree.n_leaves > 2
    for situation in rng.uniform(-1, 1, size=(100, 3)):
        value = dict(zip(tree.names, situation, strict=True))
        holding = [r for r in every if all(lo < value[n] <= up for n, (lo, up) in r.bounds.items())]
        assert holding == [rule_for(tree, situation)]
        linear = holding[0].intercept + sum(slope * value[n] for n, slope in holding[0].slopes.items())
        assert tree.predict(situation[None, :])[0] == pytest.approx(linear, rel=1e-9)


def test_an_explanation_adds_up_and_tells_when_the_rule_is_held_back():
    explanation = WRITER.explanation(small_tree(), np.array([2.0, 0.5, 0.4])).splitlines()
    assert explanation[1] == "here time = 2.415 ± 0.050 s:"
    parts = [float(line.split()[0]) for line in explanation[2:]]
    assert sum(parts) == pytest.approx(2.415, abs=0.002)
    assert explanation[3].endswith("dist = 2m")
    assert "angle_to_dest = 28.6°" in explanation[4]
    held = WRITER.explanation(small_tree(), np.array([2.0, 0.5, -9.0]))
    assert "here time = 3.500" in held
    assert (
        held.splitlines()[-1].strip() == "held within 1.000 to 3.500, since the rule saw nothing like 7.115"
    )
