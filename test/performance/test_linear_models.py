"""Linear models from normal equations, compared with plain least squares."""

import numpy as np
import pytest

from ator_ros.geometry import FloatArray
from ator_ros.performance.tree.linear_models import (
    TERM_COST,
    Standardized,
    corrected_error,
    fit_node_models,
    residual_squares,
    solve,
    squared_error,
)


def data(count: int = 200, *, noise: float = 0.3) -> tuple[FloatArray, FloatArray]:
    """Return three features of different scales, and a target that depends on two of them."""
    rng = np.random.default_rng(8)
    X = rng.normal([5.0, -2.0, 100.0], [1.0, 0.1, 30.0], (count, 3))
    return X, 3.0 + 2.0 * X[:, 0] - 7.0 * X[:, 1] + noise * rng.normal(size=count)


def moments(X: FloatArray, y: FloatArray) -> FloatArray:
    rows = Standardized.from_rows(X, y).rows
    return np.asarray(rows.T @ rows)


def test_standardized_columns_have_mean_0_and_deviation_1() -> None:
    X, y = data()
    standard = Standardized.from_rows(X, y)
    assert standard.rows[:, 0] == pytest.approx(1.0)
    assert standard.rows[:, 1:].mean(axis=0) == pytest.approx(0.0, abs=1e-9)
    assert standard.rows[:, 1:].std(axis=0) == pytest.approx(1.0)
    assert standard.mean == pytest.approx([*X.mean(axis=0), y.mean()])
    assert standard.scale == pytest.approx([*X.std(axis=0), y.std()])


def test_constant_columns_become_0() -> None:
    X, y = data()
    X[:, 1] = 4.0
    X[:, 2] = 1e9 + 1e-8 * X[:, 2]
    standard = Standardized.from_rows(X, y)
    assert standard.rows[:, 2] == pytest.approx(0.0)
    assert standard.rows[:, 3] == pytest.approx(0.0, abs=1e-4)
    assert (standard.scale > 0.0).all()
    assert standard.scale[1] == 1.0


def test_a_solution_is_that_of_least_squares() -> None:
    X, y = data()
    standard = Standardized.from_rows(X, y)
    intercepts, slopes = standard.to_units(solve(moments(X, y))[None])
    expected = np.linalg.lstsq(np.column_stack([np.ones(len(X)), X]), y, rcond=None)[0]
    assert intercepts[0] == pytest.approx(expected[0], abs=1e-3)
    assert slopes[0] == pytest.approx(expected[1:], abs=1e-4)


def test_squared_residuals_are_those_of_the_rows() -> None:
    X, y = data()
    model, normal = solve(moments(X, y)), moments(X, y)
    rows = Standardized.from_rows(X, y).rows
    residual = rows[:, -1] - rows[:, :-1] @ model
    expected = residual @ residual
    assert residual_squares(normal) == pytest.approx(expected, rel=1e-4)
    assert residual_squares(np.stack([normal, 2.0 * normal])) == pytest.approx(
        [expected, 2.0 * expected], rel=1e-4
    )
    assert squared_error(model[None], normal[None]) == pytest.approx([expected])
    assert squared_error(np.zeros((1, 4)), normal[None]) == pytest.approx([len(y)])


def test_an_exact_fit_has_no_negative_error() -> None:
    X, y = data(noise=0.0)
    normal = moments(X, y)
    assert 0.0 <= residual_squares(normal) < 1e-3
    assert squared_error(solve(normal)[None], normal[None])[0] >= 0.0


def test_the_corrected_error_grows_with_terms_and_is_infinite_without_spare_samples() -> None:
    squared, samples = np.full(4, 40.0), np.full(4, 10.0)
    error = corrected_error(squared, samples, np.array([0.0, 2.0, 9.0, 10.0]))
    assert error == pytest.approx([2.0, 2.0 * 12.0 / 8.0, 2.0 * 19.0, np.inf])
    assert corrected_error(np.zeros(1), np.ones(1), np.ones(1))[0] == np.inf


def test_terms_that_explain_nothing_are_removed() -> None:
    X, y = data(400)
    models, error = fit_node_models(moments(X, y)[None])
    assert models[0, 3] == 0.0
    assert (np.abs(models[0, 1:3]) > 0.1).all()
    expected = corrected_error(
        squared_error(models, moments(X, y)[None]), np.full(1, 400.0), np.full(1, 3 * TERM_COST)
    )
    assert error == pytest.approx(expected, rel=1e-3)


def test_nodes_are_fitted_independently() -> None:
    X, y = data(400)
    parts = [(X[:150], y[:150]), (X[150:], 5.0 - y[150:]), (X, np.ones(400))]
    together = np.stack([moments(*part) for part in parts])
    models, error = fit_node_models(together)
    for number, each in enumerate(together):
        alone, its_error = fit_node_models(each[None])
        assert models[number] == pytest.approx(alone[0])
        assert error[number] == pytest.approx(its_error[0])
    assert models[2] == pytest.approx(0.0)


def test_fewer_terms_are_kept_where_the_noise_is_greater() -> None:
    kept = []
    for noise in (0.0, 100.0):
        X, y = data(60, noise=noise)
        models, _ = fit_node_models(moments(X, y)[None])
        kept.append(np.count_nonzero(models[0, 1:]))
    assert kept[0] == 2
    assert kept[1] < 2
