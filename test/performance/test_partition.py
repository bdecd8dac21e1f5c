"""The partition of a growing tree, and the finished tree."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ator_ros.geometry import FloatArray
from ator_ros.performance.tree.linear_models import Standardized
from ator_ros.performance.tree.model_tree import ModelTreeRegressor
from ator_ros.performance.tree.nodes import Hinge, ModelTree, leaves
from ator_ros.performance.tree.partition import GrownNode, Partition
from ator_ros.performance.tree.storage import restored, stored
from ator_ros.schema import SchemaError


def bent(count: int = 300, seed: int = 1) -> tuple[FloatArray, FloatArray]:
    """Return two features, and a target that has a kink at 1.0 of the first."""
    rng = np.random.default_rng(seed)
    X = rng.uniform(0.0, 2.0, (count, 2))
    y = np.where(X[:, 0] < 1.0, 3.0 * X[:, 0], 6.0 - 3.0 * X[:, 0]) + 0.5 * X[:, 1]
    return X, y + 0.01 * rng.normal(size=count)


def grown(X: FloatArray, y: FloatArray, *, least: float = 20, most: int = 100) -> list[GrownNode]:
    return Partition(X, Standardized.from_rows(X, y).rows, least, most).grow()


def test_the_first_split_is_at_the_kink() -> None:
    nodes = grown(*bent())
    assert nodes[0].feature == 0
    assert nodes[0].threshold == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("least", [10.0, 40.0])
def test_leaves_divide_the_rows_and_keep_the_least_size(least: float) -> None:
    X, y = bent()
    nodes = grown(X, y, least=least)
    ends = [node for node in nodes if node.children is None]
    rows = np.concatenate([node.order[0] for node in ends])
    assert sorted(rows.tolist()) == list(range(len(X)))
    assert min(len(node.order[0]) for node in ends) >= least
    for node in ends:
        for column, order in enumerate(node.order):
            assert (np.diff(X[order, column]) >= 0.0).all()
            assert set(order.tolist()) == set(node.order[0].tolist())


def test_children_have_the_rows_and_moments_of_their_parent() -> None:
    X, y = bent()
    nodes = grown(X, y)
    for number, node in enumerate(nodes):
        if node.children is not None:
            first, second = (nodes[child] for child in node.children)
            assert min(node.children) > number
            assert first.moments + second.moments == pytest.approx(node.moments, abs=1e-6)
            least = min(first.target_range[0], second.target_range[0])
            greatest = max(first.target_range[1], second.target_range[1])
            assert node.target_range == (least, greatest)


def test_a_tree_has_at_most_so_many_leaves_and_the_best_splits_come_first() -> None:
    X, y = bent()
    two = grown(X, y, most=2)
    assert len(two) == 3
    assert (two[0].feature, two[0].threshold) == (0, grown(X, y)[0].threshold)
    assert len(grown(X, y, most=1)) == 1


def test_a_plane_and_equal_values_are_not_split() -> None:
    X, _ = bent()
    plane = ModelTreeRegressor(min_samples_leaf=20).fit(X, 3.0 * X[:, 0] - X[:, 1]).tree_
    assert plane.n_leaves == 1
    assert len(grown(X, np.ones(len(X)))) == 1
    same = np.ones_like(X)
    assert len(grown(same, bent()[1])) == 1
    assert len(grown(*bent(39))) == 1  # two leaves of 20 need 40 rows


def test_the_order_of_the_rows_does_not_matter() -> None:
    X, y = bent()
    mixed = np.random.default_rng(2).permutation(len(X))
    one, other = ModelTreeRegressor().fit(X, y), ModelTreeRegressor().fit(X[mixed], y[mixed])
    assert other.predict(X) == pytest.approx(one.predict(X), abs=1e-6)


def tree(**options: float) -> ModelTree:
    learned: ModelTree = ModelTreeRegressor(min_samples_leaf=20, **options).fit(*bent()).tree_
    return learned


def test_predictions_are_those_of_the_leaf_whose_bounds_hold() -> None:
    learned = tree()
    X, _ = bent(100, seed=5)
    found = learned.apply(X)
    for leaf, bounds in leaves(learned):
        inside = np.full(len(X), True)
        for name, (lower, upper) in bounds.items():
            values = X[:, learned.names.index(name)]
            inside &= (values > lower) & (values <= upper)
        assert (inside == (found == leaf)).all()
        linear = learned.intercept[leaf] + X[inside] @ learned.coefficients[leaf]
        expected = np.clip(linear, learned.lower[leaf], learned.upper[leaf])
        assert learned.predict(X[inside]) == pytest.approx(expected)
    assert learned.n_leaves == len(list(leaves(learned))) >= 2


def test_samples_add_up_and_spreads_are_near_the_noise() -> None:
    learned = tree(smoothing=0.0)
    at_leaf = learned.is_leaf
    assert learned.samples[0] == learned.samples[at_leaf].sum() == 300
    assert 0.005 < np.average(learned.spread[at_leaf], weights=learned.samples[at_leaf]) < 0.03
    inner = ~at_leaf
    assert (learned.spread[inner] == 0.0).all()
    assert (learned.coefficients[inner] == 0.0).all()
    for node in np.flatnonzero(inner):
        assert learned.samples[node] == learned.samples[learned.children[node]].sum()
        assert (learned.children[node] > node).all()


@pytest.mark.parametrize("extrapolation", [0.0, 0.5])
def test_predictions_stay_within_the_extrapolated_range_of_their_leaf(extrapolation: float) -> None:
    X, y = bent()
    learned = tree(extrapolation=extrapolation)
    leaf = learned.apply(X)
    for number in np.flatnonzero(learned.is_leaf):
        targets = y[leaf == number]
        margin = extrapolation * np.ptp(targets)
        assert learned.lower[number] == pytest.approx(targets.min() - margin, abs=1e-9)
        assert learned.upper[number] == pytest.approx(targets.max() + margin, abs=1e-9)


def test_smoothing_moves_leaves_toward_the_root() -> None:
    X, y = bent()
    root = ModelTreeRegressor(max_leaves=1, min_samples_leaf=20).fit(X, y).predict(X)
    distances = []
    for smoothing in (0.0, 15.0, 1e9):
        predicted = (
            ModelTreeRegressor(min_samples_leaf=20, smoothing=smoothing).fit(X, y).predict(X)
        )
        distances.append(np.abs(predicted - root).mean())
    assert distances[0] > distances[1] > distances[2]
    assert distances[2] < 0.05


def test_a_smoothed_leaf_is_the_weighted_mean_of_its_model_and_the_root() -> None:
    X, y = bent()
    options = {"min_samples_leaf": 20, "max_leaves": 2, "extrapolation": 10.0}
    plain = ModelTreeRegressor(smoothing=0.0, **options).fit(X, y).tree_
    smooth = ModelTreeRegressor(smoothing=100.0, **options).fit(X, y).tree_
    root = ModelTreeRegressor(max_leaves=1, extrapolation=10.0).fit(X, y).predict(X)
    leaf = plain.apply(X)
    share = plain.samples[leaf] / (plain.samples[leaf] + 100.0)
    expected = share * plain.predict(X) + (1.0 - share) * root
    # traces of terms are removed
    assert smooth.predict(X) == pytest.approx(expected, abs=0.03)


def test_irrelevant_features_are_not_used_and_a_narrowed_tree_predicts_the_same() -> None:
    rng = np.random.default_rng(6)
    X, y = bent()
    wide = np.column_stack([rng.normal(size=len(X)), X])
    learned = ModelTreeRegressor(min_samples_leaf=40, smoothing=0.0).fit(wide, y).tree_
    assert learned.used_features() == ("x1", "x2")
    narrow = learned.narrowed()
    assert narrow.names == ("x1", "x2")
    assert (narrow.predict(X) == learned.predict(wide)).all()
    assert learned.constant is None


def test_a_tree_of_a_constant_needs_no_features() -> None:
    X, _ = bent()
    learned = ModelTreeRegressor().fit(X, np.full(len(X), 4.5)).tree_
    assert learned.constant == pytest.approx(4.5)
    assert learned.used_features() == ()
    assert len(learned.narrowed().names) == 1
    with_base = dataclasses.replace(learned, base=(Hinge("x0", 0.0, 1.0),))
    assert with_base.constant is None
    assert with_base.used_features() == ("x0",)


@settings(deadline=None, max_examples=30)
@given(above=st.floats(0.1, 1.5), slope=st.floats(-3.0, 3.0), value=st.floats(0.0, 2.0))
def test_terms_of_the_base_are_added(above: float, slope: float, value: float) -> None:
    learned = tree()
    base = (Hinge("x0", above, slope), Hinge("x1", 0.0, 2.0 * slope))
    X = np.array([[value, 0.7]])
    with_base = dataclasses.replace(learned, base=base)
    expected = slope * max(0.0, value - above) + 2.0 * slope * 0.7
    assert with_base.predict(X)[0] - learned.predict(X)[0] == pytest.approx(expected)
    assert sum(hinge.of(X[0, column]) for column, hinge in enumerate(base)) == pytest.approx(
        expected
    )


def test_a_stored_tree_predicts_the_same_to_the_last_bit() -> None:
    learned = dataclasses.replace(tree(), base=(Hinge("x0", 0.5, 1.5),))
    again = restored(stored(learned))
    X, _ = bent(100, seed=9)
    rows = np.ascontiguousarray(X.T)
    for one, other in zip(learned.evaluate(rows), again.evaluate(rows), strict=True):
        assert (one == other).all()
    for name in ("samples", "spread", "threshold", "lower", "upper", "children"):
        assert (getattr(learned, name) == getattr(again, name)).all()
    assert stored(again) == stored(learned)


def test_stored_trees_are_checked() -> None:
    whole = stored(tree())
    with pytest.raises(SchemaError, match="names, each once"):
        dataclasses.replace(whole, features=("x0", "x0"))
    with pytest.raises(SchemaError, match="the features x0, x1"):
        dataclasses.replace(whole, base=(Hinge("x7", 0.0, 1.0),))
    with pytest.raises(SchemaError, match="the features x1"):
        dataclasses.replace(whole, features=("x1",))
    leaf = stored(ModelTreeRegressor().fit(bent()[0], np.ones(300)).tree_).root
    for wrong in ((2.0, 1.0), (1.0,), (1.0, 2.0, 3.0)):
        with pytest.raises(SchemaError, match="two numbers, the lower bound first"):
            dataclasses.replace(leaf, range=wrong)
    assert dataclasses.replace(leaf, range=(1.0, 1.0)).range == (1.0, 1.0)
