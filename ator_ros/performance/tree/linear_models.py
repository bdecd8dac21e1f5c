"""Linear models of many nodes at once, from their normal equations alone (paper, section 3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ator_ros.geometry import FloatArray, IntArray

# Moments are the normal equations of nodes over standardized rows, shape (…, n_features + 2,
# n_features + 2).

# Added to the diagonal of the moments: it determines the slopes of features that are constant or
# collinear in a node, and biases the others by a millionth.
_RIDGE = 1e-6
# Deviation up to which a feature, in m, rad or s, varies by rounding only: differences of
# coordinates of 1e8 m, the greatest in messages, are rounded to 15 nm.
_LEAST_DEVIATION = 1e-7
# How much each term of a model counts in v of the corrected error. Quinlan's 1 does not count the
# choice of the split and keeps half as many leaves again without being more accurate.
TERM_COST = 2.0
# Share of the target's squares that keeps an exact fit from appearing better than exact by
# rounding.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Standardized:
    """Rows that are centered and scaled, for well-conditioned normal equations.

    Attributes
    ----------
    rows : array of float, shape (n, n_features + 2)
        The constant 1, the features and the target, with mean 0 and deviation 1 (or 0).
    mean, scale : array of float, shape (n_features + 1,)
        Means and deviations of features and target, in their units.
    """

    rows: FloatArray
    mean: FloatArray
    scale: FloatArray

    @classmethod
    def from_rows(cls, X: FloatArray, y: FloatArray) -> Standardized:
        """Standardize features of shape (n, n_features) and targets of shape (n,)."""
        table = np.column_stack([X, y])
        mean = table.mean(axis=0)
        variance = ((table - mean) ** 2).mean(axis=0)
        deviation = np.sqrt(variance)
        # A column that varies by rounding only is a constant.
        scale = np.where(deviation > 1e-12 * np.abs(mean), deviation, 0.0)
        features = scale[:-1]
        features[features < _LEAST_DEVIATION] = 0.0
        scale[scale == 0] = 1.0
        constant = np.ones(len(X))
        rows = np.column_stack([constant, (table - mean) / scale])
        return cls(rows, mean, scale)

    def to_units(self, models: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Convert models of standardized rows to units of features and target.

        Parameters
        ----------
        models : array of float, shape (n_nodes, 1 + n_features)
            Constants and slopes.

        Returns
        -------
        intercepts : array of float, shape (n_nodes,)
        slopes : array of float, shape (n_nodes, n_features)
        """
        of_target = self.scale[-1]
        of_features = self.scale[:-1]
        slopes = models[:, 1:] * of_target / of_features
        at_mean = models[:, 0] * of_target + self.mean[-1]
        intercepts = at_mean - slopes @ self.mean[:-1]
        return intercepts, slopes


def solve(moments: FloatArray) -> FloatArray:
    """Return the linear model of one node with all features: constant and slopes.

    `moments` have the shape (n_features + 2, n_features + 2), the model (1 + n_features,). Both are
    standardized.
    """
    samples = moments[0, 0]
    left = moments[:-1, :-1] / samples
    np.fill_diagonal(left, left.diagonal() + _RIDGE)
    right = moments[:-1, -1] / samples
    return np.asarray(np.linalg.solve(left, right))


def residual_squares(moments: FloatArray) -> FloatArray:
    """Return the sum of squared residuals of the linear model with all features, shape (…).

    `moments` have the shape (…, n_features + 2, n_features + 2).
    """
    weight = moments[..., 0, 0]
    scaled = moments / weight[..., None, None]
    terms = np.arange(moments.shape[-1] - 1)
    scaled[..., terms, terms] += _RIDGE
    scaled[..., -1, -1] *= 1.0 + _ROUNDING
    # The square of the last diagonal element of the Cholesky factor is the residual of the target.
    root = np.linalg.cholesky(scaled)[..., -1, -1]
    return np.asarray(weight * root**2)


def squared_error(models: FloatArray, moments: FloatArray) -> FloatArray:
    """Return the sum of squared residuals of models, shape (n_nodes,).

    `models` have the shape (n_nodes, 1 + n_features), `moments` the shape
    (n_nodes, n_features + 2, n_features + 2).
    """
    residual = np.column_stack([-models, np.ones(len(models))])
    error = np.einsum("ni,nij,nj->n", residual, moments, residual)
    return np.asarray(np.maximum(error, 0.0))


def corrected_error(squared: FloatArray, samples: FloatArray, terms: FloatArray) -> FloatArray:
    """Return M5's estimate of the root-mean-square error on new rows: RMSE × (n + v) / (n − v).

    It is infinite where there are no more samples than terms. All arrays have the shape (n_nodes,);
    the result has the unit of the target.

    Parameters
    ----------
    squared, samples : array of float
        Sum of squared residuals on the learning rows, and n, the number of these rows.
    terms : array of float
        v: the number of terms of the model, including the constant.
    """
    spare = samples - terms
    divisor = np.where(spare > 0, spare, 1.0)
    factor = np.where(
        spare > 0,
        (samples + terms) / divisor,
        np.inf,
    )
    # The floor keeps a perfect fit with too few samples (0 × infinity) infinitely bad.
    rms = np.sqrt(np.maximum(squared / samples, 1e-24))
    return np.asarray(rms * factor)


def fit_node_models(moments: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Fit the linear model of every node, and remove terms greedily.

    Terms are removed while the corrected error does not grow. The moments of all nodes are swept
    together: sweeping a column in or out adds or removes its term, and the swept matrix has the
    cost of each removal.

    Parameters
    ----------
    moments : array of float, shape (n_nodes, n_features + 2, n_features + 2)
        Normal equations of standardized rows.

    Returns
    -------
    models : array of float, shape (n_nodes, 1 + n_features)
        Constant and slopes, for standardized rows; removed terms are 0.
    error : array of float, shape (n_nodes,)
        Corrected error of each model.
    """
    samples = moments[:, 0, 0]
    swept = moments / samples[:, None, None]
    n_terms = moments.shape[1] - 1
    features = np.arange(1, n_terms)
    swept[:, features, features] += _RIDGE
    every = np.zeros(len(swept), dtype=np.intp)
    for term in range(n_terms):
        swept = _sweep(swept, every + term)
    kept = np.ones((len(swept), n_terms), dtype=bool)
    all_terms = np.full(len(swept), TERM_COST * n_terms)
    error = corrected_error(swept[:, -1, -1] * samples, samples, all_terms)
    active = np.arange(len(swept))
    while len(active):
        # The term of each node whose removal costs least, and the mean squared error without it.
        left = swept[active]
        there = kept[active]
        diagonal = left.diagonal(axis1=1, axis2=2)
        variance = np.abs(diagonal[:, :-1])
        increase = np.where(
            there,
            left[:, :-1, -1] ** 2 / variance,
            np.inf,
        )
        increase[:, 0] = np.inf
        column = increase.argmin(axis=1)
        least = increase[np.arange(len(left)), column]
        squared = np.maximum(left[:, -1, -1], 0.0) + least
        terms = TERM_COST * (there.sum(axis=1) - 1)
        candidate = corrected_error(squared * samples[active], samples[active], terms)
        better = np.isfinite(squared) & (candidate <= error[active])
        active = active[better]
        column = column[better]
        candidate = candidate[better]
        swept[active] = _sweep(swept[active], column)
        kept[active, column] = False
        error[active] = candidate
    models = np.where(kept, swept[:, :-1, -1], 0.0)
    return models, error


def _sweep(matrices: FloatArray, column: IntArray) -> FloatArray:
    """Sweep one column of each symmetric matrix, to add a missing term or remove a present one."""
    node = np.arange(len(matrices))
    pivot = matrices[node, column, column]
    row = matrices[node, column, :]
    products = row[:, :, None] * row[:, None, :]
    swept = matrices - products / pivot[:, None, None]
    row = row / np.abs(pivot)[:, None]
    swept[node, column, :] = row
    swept[node, :, column] = row
    swept[node, column, column] = -1.0 / pivot
    return swept
