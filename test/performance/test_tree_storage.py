"""Storing model trees: exact there and back, and nothing else gets in."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from ator_ros.performance.tree.model_tree import ModelTreeRegressor
from ator_ros.performance.tree.nodes import ModelTree
from ator_ros.performance.tree.storage import StoredTree, restored, stored
from ator_ros.schema import structured, unstructured

RNG = np.random.default_rng(1)
X = RNG.uniform(-1, 1, size=(1500, 3))
Y = np.abs(X[:, 0]) + np.maximum(X[:, 1], 0.3) + RNG.normal(0, 0.01, 1500)


@pytest.fixture(scope="module", params=[1.0, None])
def tree(request: pytest.FixtureRequest) -> ModelTree:
    return ModelTreeRegressor(extrapolation=request.param).fit(X, Y).tree_


def test_a_tree_survives_json_to_the_last_bit(tree):
    text = json.dumps(unstructured(stored(tree)), allow_nan=False)
    back = restored(structured(json.loads(text), StoredTree))
    assert back.names == tree.names == ("x0", "x1", "x2")
    for field in fields(ModelTree)[1:]:
        kept, learned = getattr(back, field.name), getattr(tree, field.name)
        np.testing.assert_array_equal(kept, learned)
        assert kept.dtype == learned.dtype
    np.testing.assert_array_equal(back.predict(X), tree.predict(X))
    assert json.dumps(unstructured(stored(back))) == text


def leaf(data: dict[str, Any]) -> dict[str, Any]:
    """Return the leftmost leaf."""
    node: dict[str, Any] = data["root"]
    while "feature" in node:
        node = node["at_most"]
    return node


DAMAGES: list[tuple[Callable[[dict[str, Any]], object], str]] = [
    (lambda s: s.pop("root"), "expected the fields features, root; missing root"),
    (lambda s: s.update(features=["x0", "x1", "x1"]), "features: expected names, each once"),
    (lambda s: s["root"].update(feature="y"), "root: expected the features x0, x1, x2; got 'y'"),
    (lambda s: s["root"].update(threshold=math.nan), "root.threshold: expected a finite number; got nan"),
    (lambda s: s["root"].pop("above"), "root: expected the fields .*; missing above"),
    (lambda s: leaf(s)["slopes"].update(y=1.0), r"root: expected the features x0, x1, x2; got 'y'"),
    (lambda s: leaf(s).update(range=[2, 1]), r"range: expected the lower bound first; got \[2\.0, 1\.0\]"),
]


@pytest.mark.parametrize(("damage", "message"), DAMAGES)
def test_damage_is_refused_by_name(tree, damage, message):
    data = json.loads(json.dumps(unstructured(stored(tree))))
    damage(data)
    with pytest.raises(ValueError, match=message):
        restored(structured(data, StoredTree))
