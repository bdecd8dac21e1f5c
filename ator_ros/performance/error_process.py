"""The errors of a model as a Gaussian process over its features.

See Rasmussen and Williams 2006, chapter 2. The process is fitted to errors on episodes that the
model was not learned from. Where similar episodes have an error, the same error is expected. Where
there are none, the mean is 0 and the deviation `signal`. The spread of models of resampled episodes
would not show such errors, because models of the same form share them.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np

from ator_ros.compiled import compiled
from ator_ros.geometry import FloatArray
from ator_ros.schema import Within, require

# episodes kept, evenly spaced: more hardly change the result, and make a request slower
_MOST_EPISODES = 300
# An error this many standard deviations from the median of similar episodes is an accident. It is
# clipped there.
_CLIPPED_AT = 4.0
_NEIGHBORS = 7  # similar episodes, the episode itself included
# Least ratio of `ErrorProcess.signal` to the standard deviation of the errors. Without it, a few
# episodes whose errors do not depend on the features by chance give almost no uncertainty.
_LEAST_SIGNAL_RATIO = 0.5
# least and greatest length of the process in standard deviations of a single feature
_LENGTHS = (0.2, 1.0)
_DIGITS = 4  # decimals kept of errors (s) and standardized features
_Positive = Annotated[float, Within(1e-9)]


@dataclass(frozen=True, eq=False)
class ErrorProcess:
    """Errors of predicted durations as a Gaussian process with a Matérn kernel (3/2).

    Attributes
    ----------
    features : tuple of str
        Names of k features.
    center, scale : tuple of float
        Means and standard deviations of the features, length k.
    points : tuple of tuple of float, shape (n, k)
        Episodes, their features standardized.
    errors : tuple of float
        Actual less predicted duration in s of each episode, by a model that was learned without it.
    signal, noise : float
        Standard deviations in s of the process, and of what differs between similar episodes.
    length : float
        Distance between points over which errors are similar.

    Raises
    ------
    SchemaError
        The lengths of the fields differ, or the number of episodes is not 1 to 300.
    """

    features: tuple[str, ...]
    center: tuple[float, ...]
    scale: tuple[_Positive, ...]
    points: tuple[tuple[float, ...], ...]
    errors: tuple[float, ...]
    signal: _Positive
    noise: _Positive
    length: _Positive

    def __post_init__(self) -> None:
        """Check the shapes."""
        k = len(self.features)
        same_points = all(len(each) == k for each in self.points)
        alike = len(self.center) == len(self.scale) == k and same_points
        require(alike, "points", f"{k} numbers each, as center and scale have", "others")
        few = 1 <= len(self.points) <= _MOST_EPISODES
        require(few, "points", f"1 to {_MOST_EPISODES} episodes", len(self.points))
        paired = len(self.errors) == len(self.points)
        require(paired, "errors", "one for each point", len(self.errors))

    def of_sum(self, features: FloatArray, signs: FloatArray) -> tuple[float, float]:
        """Return the expected error of a signed sum of durations in s, and its variance in s².

        `features` (n, k) are the situations, `signs` (n,) those of their durations in the sum.
        """
        known, inverse, weights, center, scale = self._solved
        points = np.ascontiguousarray((features - center) / scale)
        similar = signs @ _kernel(points, known, self.signal, self.length)
        covariances = _kernel(points, points, self.signal, self.length)
        variance = signs @ covariances @ signs
        variance -= similar @ inverse @ similar
        return float(similar @ weights), max(float(variance), 0.0)

    @cached_property
    def _solved(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """Points (n, k), inverse of their covariances (n, n), their weights (n,), center, scale."""
        known = np.array(self.points)
        noise = self.noise**2 * np.eye(len(known))
        covariances = _kernel(known, known, self.signal, self.length) + noise
        inverse: FloatArray = np.asarray(np.linalg.inv(covariances), dtype=float)
        weights = inverse @ _clipped(np.array(self.errors), known)
        center = np.array(self.center)
        scale = np.array(self.scale)
        return known, inverse, weights, center, scale


@compiled
def _kernel(
    one: FloatArray,
    other: FloatArray,
    signal: float,
    length: float,
) -> FloatArray:
    """Return the Matérn kernel (3/2) of points (n, k) and (m, k), shape (n, m)."""
    found = np.empty((len(one), len(other)))
    for row in range(len(one)):
        for column in range(len(other)):
            square = 0.0
            for feature in range(one.shape[1]):
                square += (one[row, feature] - other[column, feature]) ** 2
            scaled = math.sqrt(3.0 * square) / length
            falling = math.exp(-scaled)
            found[row, column] = signal * signal * (1.0 + scaled) * falling
    return found


def fit_error_process(
    names: Sequence[str], features: FloatArray, errors: FloatArray
) -> ErrorProcess:
    """Return the process of greatest likelihood.

    Parameters
    ----------
    names : sequence of str
        Names of the k features.
    features : array of float, shape (n, k)
        Features of episodes.
    errors : array of float, shape (n,)
        Their actual less predicted durations in s.
    """
    # Only learning needs scikit-learn; nodes start without it.
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

    count = min(len(errors), _MOST_EPISODES)
    kept = np.linspace(0, len(errors) - 1, count).astype(int)
    features = features[kept]
    errors = errors[kept].round(_DIGITS)
    center = features.mean(axis=0)
    scale = features.std(axis=0)
    scale[scale < 1e-9] = 1.0
    points = np.round((features - center) / scale, _DIGITS)
    spread = robust_spread(errors)
    shortest, longest = (length * np.sqrt(len(names)) for length in _LENGTHS)
    signal_bounds = ((_LEAST_SIGNAL_RATIO * spread) ** 2, (10.0 * spread) ** 2)
    signal = ConstantKernel(spread**2, signal_bounds)
    kernel = signal * Matern(0.5 * longest, (shortest, longest), nu=1.5)
    noise_bounds = ((0.2 * spread) ** 2, (3.0 * spread) ** 2)
    noise = WhiteKernel(spread**2, noise_bounds)
    with warnings.catch_warnings():  # results at a bound are intended
        warnings.simplefilter("ignore", ConvergenceWarning)
        process = GaussianProcessRegressor(kernel + noise).fit(points, _clipped(errors, points))
    found = process.kernel_.get_params()
    return ErrorProcess(
        tuple(names),
        tuple(center.tolist()),
        tuple(scale.tolist()),
        tuple(map(tuple, points.tolist())),
        tuple(errors.tolist()),
        signal=float(np.sqrt(found["k1__k1__constant_value"])),
        noise=float(np.sqrt(found["k2__noise_level"])),
        length=float(found["k1__k2__length_scale"]),
    )


def robust_spread(errors: FloatArray) -> float:
    """Return the standard deviation of errors in s, robust against outliers; at least 1 ms.

    It is the median absolute deviation, scaled as for a normal distribution.
    """
    deviations = np.abs(errors - np.median(errors))
    return max(1.4826 * float(np.median(deviations)), 1e-3)


def _clipped(errors: FloatArray, points: FloatArray) -> FloatArray:
    """Return the errors (n,), clipped around the median of similar episodes."""
    count = min(_NEIGHBORS, len(errors))
    squares = np.square(points[:, None] - points).sum(axis=2)
    nearest = np.argpartition(squares, count - 1, axis=1)[:, :count]
    usual = np.median(errors[nearest], axis=1)
    most = _CLIPPED_AT * robust_spread(errors)
    return np.asarray(errors.clip(usual - most, usual + most))
