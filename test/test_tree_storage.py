"""Storing model trees: exact there and back, and nothing else gets in."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from ator_ros.performance.tree.model_tree import ModelTreeRegressor
from ator_ros.performance.tree.nodes import ModelTree
from ator_ros.performance.tree.storage import ModelTreeFormatError, tree_from_dict, tree_to_dict

RNG = np.random.default_rng(1)
X = RNG.uniform(-1, 1, size=(1500, 3))
Y = np.abs(X[:, 0]) + np.maximum(X[:, 1], 0.3) + RNG.normal(0, 0.01, 1500)


@pytest.fixture(scope="module", params=[1.0, None])
def tree(request: pytest.FixtureRequest) -> ModelTree:
    return ModelTreeRegressor(extrapolation=request.param).fit(X, Y).tree_


def test_a_tree_survives_json_to_the_last_bit(tree):
    text = json.dumps(tree_to_dict(tree), allow_nan=False)
    back = tree_from_dict(json.loads(text))
    assert back.names == tree.names
    for field in fields(ModelTree)[1:]:
        stored, learned = getattr(back, field.name), getattr(tree, field.name)
        np.testing.assert_array_equal(stored, learned)
        assert stored.dtype == learned.dtype
    np.testing.assert_array_equal(back.predict(X), tree.predict(X))
    assert json.dumps(tree_to_dict(back)) == text


def test_the_stored_form_can_be_read(tree):
    stored = tree_to_dict(tree)
    assert stored["features"] == ["x0", "x1", "x2"]
    node = stored["root"]
    assert node["feature"] in stored["features"]
    while "feature" in node:
        node = node["at_most"]
    assert set(node) == {"samples", "intercept", "slopes", "range", "spread"}


def test_other_features_are_refused(tree):
    with pytest.raises(ModelTreeFormatError, match="features: expected dist, v, w; got x0, x1, x2"):
        tree_from_dict(tree_to_dict(tree), names=["dist", "v", "w"])


def leaf(stored: dict[str, Any]) -> dict[str, Any]:
    """Return the leftmost leaf."""
    node: dict[str, Any] = stored["root"]
    while "feature" in node:
        node = node["at_most"]
    return node


DAMAGES: list[tuple[Callable[[dict[str, Any]], object], str]] = [
    (lambda s: s.pop("root"), "tree: expected the fields features, root; missing root"),
    (lambda s: s.update(extra=1), "tree: .*unknown extra"),
    (lambda s: s.update(features=[]), "features: expected a list of names; got"),
    (lambda s: s.update(features=["x0", "x1", "x1"]), "features: expected every name once"),
    (lambda s: s["root"].update(feature="y"), "root.feature: expected one of x0, x1, x2; got 'y'"),
    (lambda s: s["root"].update(threshold="1"), "root.threshold: expected a finite number; got '1'"),
    (lambda s: s["root"].update(threshold=True), "root.threshold: expected a finite number; got True"),
    (lambda s: s["root"].update(threshold=math.nan), "root.threshold: expected a finite number; got nan"),
    (lambda s: s["root"].update(samples=-1), "root.samples: expected a finite number of at least 0; got -1"),
    (lambda s: s["root"].update(above=[]), "root.above: expected a table with intercept"),
    (lambda s: s["root"].pop("above"), "root: expected the fields .*; missing above"),
    (lambda s: leaf(s).pop("spread"), r"root\.at_most.*: expected the fields .*; missing spread"),
    (lambda s: leaf(s).update(spread=-0.1), r"spread: expected a finite number of at least 0"),
    (lambda s: leaf(s).update(intercept=None), r"intercept: expected a finite number; got None"),
    (lambda s: leaf(s).update(slopes=[1]), r"slopes: expected a table; got \[1\]"),
    (lambda s: leaf(s)["slopes"].update(y=1.0), r"slopes: expected one of x0, x1, x2; got 'y'"),
    (lambda s: leaf(s)["slopes"].update(x0=math.inf), r"slopes\.x0: expected a finite number; got inf"),
    (lambda s: leaf(s).update(range=[1]), r"range: expected two numbers or nulls; got \[1\.0\]"),
    (lambda s: leaf(s).update(range=[2, 1]), r"range\[1\]: expected a finite number of at least 2; got 1"),
]


@pytest.mark.parametrize(("damage", "message"), DAMAGES)
def test_damage_is_refused_by_name(tree, damage, message):
    stored = copy.deepcopy(tree_to_dict(tree))
    damage(stored)
    with pytest.raises(ModelTreeFormatError, match=message):
        tree_from_dict(stored)


@pytest.mark.parametrize("foreign", [None, [], "tree", 3, {}, {"classes": ["a"]}])
def test_foreign_values_are_refused(foreign):
    with pytest.raises(ModelTreeFormatError, match="tree: expected"):
        tree_from_dict(foreign)


def test_a_very_deep_tree_neither_recurses_nor_hides_its_error():
    node: dict[str, Any] = {"wrong": 0}
    for _ in range(5000):
        bottom = {"samples": 1, "intercept": 0, "slopes": {}, "range": [0, 0], "spread": 0}
        node = {"samples": 1, "feature": "a", "threshold": 0.0, "at_most": bottom, "above": node}
    with pytest.raises(ModelTreeFormatError, match="expected the fields") as refused:
        tree_from_dict({"features": ["a"], "root": node})
    assert len(str(refused.value)) < 500
