"""The model tree learner: accuracy, invalid parameters, and scikit-learn compatibility."""

import numpy as np
import pytest
from numpy.typing import NDArray
from selection import few
from sklearn.tree import DecisionTreeRegressor
from sklearn.utils.estimator_checks import check_estimator

from ator_ros.performance.tree.model_tree import ModelTreeRegressor

Array = NDArray[np.float64]


def kinked(n: int, seed: int) -> tuple[Array, Array]:
    """Time of a trapezoidal profile plus the nearer of two turns, and irrelevant features."""
    rng = np.random.default_rng(seed)
    dist, angle = rng.uniform(0.0, 4.0, n), rng.uniform(0.0, np.pi, n)
    idle = rng.normal(size=(n, 3))
    driving = np.where(dist < 1.25, 2 * np.sqrt(dist / 0.8), dist + 1.25)
    turning = np.minimum(angle / 2.6, (np.pi - angle) / 2.6 + 0.3)
    return np.column_stack([dist, angle, idle]), driving + turning + rng.normal(0.0, 0.02, n)


def rmse(actual: Array, predicted: Array) -> float:
    return float(np.sqrt(np.mean((actual - predicted) ** 2)))


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.SkipTestWarning")
@pytest.mark.parametrize("least", few([15, 3], 15))
def test_is_a_scikit_learn_estimator(least):
    check_estimator(ModelTreeRegressor(min_samples_leaf=least))


@pytest.mark.parametrize("size", [1e-16, 1e-11, 1e-8])
def test_a_feature_that_varies_by_rounding_only_has_no_slope(size: float):
    rng = np.random.default_rng(1)
    X, y = kinked(60, 4)
    X[:, 2] = size * (y + 0.001 * rng.normal(size=len(X)))
    fresh, _ = kinked(60, 5)
    tree = ModelTreeRegressor().fit(X, y)
    fresh[:, 2] = 0.5
    assert np.abs(tree.predict(fresh)).max() < 10.0


def test_finds_the_kinks_better_than_a_tree_of_constants():
    X, y = kinked(4000, 2)
    fresh_X, fresh_y = kinked(2000, 3)
    tree = ModelTreeRegressor().fit(X, y)
    constants = DecisionTreeRegressor(min_samples_leaf=30, random_state=0).fit(X, y)
    assert rmse(fresh_y, tree.predict(fresh_X)) < 0.03
    assert rmse(fresh_y, tree.predict(fresh_X)) < 0.5 * rmse(fresh_y, constants.predict(fresh_X))
    assert tree.tree_.n_leaves < constants.get_n_leaves() / 2
    with pytest.raises(ValueError, match=r"expected features of shape \(n, 5\), got"):
        tree.tree_.predict(fresh_X[:, :2])


def test_extrapolation_stays_near_the_training_targets():
    X, y = kinked(1000, 17)
    far = np.array([[1e6, 1.0, 0.0, 0.0, 0.0]])
    span = np.ptp(y)
    assert ModelTreeRegressor(extrapolation=0.0).fit(X, y).predict(far)[0] <= y.max()
    assert ModelTreeRegressor().fit(X, y).predict(far)[0] <= y.max() + span
    assert ModelTreeRegressor(extrapolation=1e6).fit(X, y).predict(far)[0] > y.max() + 100 * span
