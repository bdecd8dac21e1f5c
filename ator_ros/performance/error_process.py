"""The errors of a model as a Gaussian process over its features.

See Rasmussen and Williams 2006, chapter 2. The process is fitted to errors on episodes that the
model was not learned from. Where similar episodes have an error, the same error is expected. Where
there are none, the mean is 0, and the deviation is `signal` and what the slopes of the model may be
wrong by. It grows with the distance to the episodes along a feature that they hardly varied. The
spread of models of resampled episodes would not show such errors, because models of the same form
share them.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, NamedTuple

import numpy as np

from ator_ros.compiled import compiled
from ator_ros.geometry import FloatArray, IntArray
from ator_ros.performance.prior import Slope
from ator_ros.schema import Within, require
from ator_ros.world.state import CONTROL_PERIOD

# episodes kept, evenly spaced: more hardly change the result, and make a request slower
_MOST_EPISODES = 300
# An error this many standard deviations from the median of similar episodes is an accident. It is
# clipped there.
_CLIPPED_AT = 4.0
_NEIGHBORS = 7  # similar episodes, the episode itself included
# Least ratio of `ErrorProcess.signal` to the standard deviation of the errors, of up to so many
# episodes. Without it, a few episodes whose errors do not depend on the features by chance give
# almost no uncertainty. That chance falls with the root of their number.
_LEAST_SIGNAL_RATIO = 0.5
_FEW = 40
# least and greatest length of the process in standard deviations of a single feature
_LENGTHS = (0.2, 1.0)
TIMING = CONTROL_PERIOD / math.sqrt(12.0)
"""Standard deviation in s of durations that are whole control ticks: none is known better."""
_NO_ANGLE = 1e-3  # rad; smaller ones are rounding errors
_DIGITS = 4  # decimals kept of errors (s) and standardized features
_Positive = Annotated[float, Within(1e-9)]
_NonNegative = Annotated[float, Within(0.0)]


@dataclass(frozen=True)
class UnknownSlope:
    """A slope of durations along a feature that the episodes of a process do not show.

    Attributes
    ----------
    feature : str
        Name of the feature.
    deviation : float
        Standard deviation of the error of the slope, in s per unit of the feature.
    ends : tuple of float or None
        Between which values of the feature it is unknown; None: everywhere.
    bend : float
        Along which distance of the feature the slope is the same; 0: along all of it.
    """

    feature: str
    deviation: _NonNegative
    ends: tuple[float, float] | None = None
    bend: _NonNegative = 0.0

    @property
    def bounds(self) -> FloatArray:
        """The ends of the parts along which the slope is the same, shape (2, parts)."""
        low, high = self.ends or (-math.inf, math.inf)
        parts = max(round((high - low) / self.bend), 1) if self.ends and self.bend else 1
        edges = np.linspace(low, high, parts + 1) if parts > 1 else np.array([low, high])
        return np.stack([edges[:-1], edges[1:]])


class _Situations(NamedTuple):
    """The standardized features of n situations, and how the unknown slopes may change durations.

    That is by how many s each part of a slope may change them, shape (n, parts).
    """

    points: FloatArray
    reaches: FloatArray


@dataclass(frozen=True, eq=False)
class ErrorProcess:
    """Errors of predicted durations as a Gaussian process.

    Its kernel is a Matérn kernel (3/2), and for each feature one of errors with random slopes.

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
    slopes : tuple of UnknownSlope
        Along features, and parts of them, where the episodes do not show the slope of durations.
    corrects : bool or None
        Whether predicted durations include the expected errors, so that none is expected of them.
        None, which files omit: no.

    Raises
    ------
    SchemaError
        The lengths of the fields differ, or there are more than 300 episodes.
    """

    features: tuple[str, ...]
    center: tuple[float, ...]
    scale: tuple[_Positive, ...]
    points: tuple[tuple[float, ...], ...]
    errors: tuple[float, ...]
    signal: _Positive
    noise: _Positive
    length: _Positive
    slopes: tuple[UnknownSlope, ...] = ()
    corrects: bool | None = None

    def __post_init__(self) -> None:
        """Check the shapes."""
        k = len(self.features)
        same_points = all(len(each) == k for each in self.points)
        alike = len(self.center) == len(self.scale) == k and same_points
        require(alike, "points", f"{k} numbers each, as center and scale have", "others")
        few = len(self.points) <= _MOST_EPISODES
        require(few, "points", f"at most {_MOST_EPISODES} episodes", len(self.points))
        paired = len(self.errors) == len(self.points)
        require(paired, "errors", "one for each point", len(self.errors))
        unknown = {slope.feature for slope in self.slopes}.difference(self.features)
        require(not unknown, "slopes", "features of the process", sorted(unknown))

    @property
    def not_varied(self) -> tuple[str, ...]:
        """The features that the episodes hardly varied: they show no slope along them."""
        if not self.points:
            return ()
        deviations = np.std(self.points, axis=0) * math.sqrt(len(self.points)) * self.scale
        slopes = {slope.feature: slope.deviation for slope in self.slopes}
        pairs = zip(self.features, deviations.tolist(), strict=True)
        return tuple(
            name for name, deviation in pairs if slopes.get(name, math.inf) * deviation < self.noise
        )

    def joint(self, features: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the expected errors (n,) of n durations in s, and their covariances (n, n) in s².

        `features` (n, k) are the situations.
        """
        known, inverse, weights = self._solved
        situations = self._situations(features)
        similar = self._covariances(situations, known)
        covariances = self._covariances(situations, situations)
        expected = np.zeros(len(features)) if self.corrects else similar @ weights
        return expected, covariances - similar @ inverse @ similar.T

    def correction(self, features: FloatArray) -> FloatArray:
        """Return what to add to n predicted durations, shape (n,), in s.

        `features` (n, k) are the situations.
        """
        if not (self.corrects and self.points):
            return np.zeros(len(features))
        known, _, weights = self._solved
        return np.asarray(self._covariances(self._situations(features), known) @ weights)

    def of_sum(self, features: FloatArray, signs: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the expected errors of signed sums of durations in s, and their variances in s².

        `features` (n, k) are the situations, `signs` (..., n) those of their durations in the sums.
        The results have the shape (...).
        """
        return errors_of_sums(*self.joint(features), signs)

    def correction_rule(self) -> str:
        """Return in words what `correction` adds."""
        count = len(self.points)
        return f"and what {count} drives took longer than that in similar situations"

    def deviations(self, features: FloatArray) -> FloatArray:
        """Return the root mean squares of the errors in s of n durations, shape (n,).

        `features` (n, k) are the situations.
        """
        known, inverse, weights = self._solved
        situations = self._situations(features)
        similar = self._covariances(situations, known)
        variances = self.signal**2 + np.sum(np.square(situations.reaches), axis=1)
        variances -= np.sum(similar @ inverse * similar, axis=1)
        expected = 0.0 if self.corrects else similar @ weights
        return np.asarray(np.sqrt(np.maximum(variances, 0.0) + np.square(expected)))

    @cached_property
    def _solved(self) -> tuple[_Situations, FloatArray, FloatArray]:
        """Situations of the n episodes, inverse of their covariances (n, n), weights (n,)."""
        points = np.array(self.points).reshape(-1, len(self.features))
        known = self._situations(points * self._scale + self._center)
        noise = self.noise**2 * np.eye(len(points))
        covariances = self._covariances(known, known) + noise
        inverse: FloatArray = np.asarray(np.linalg.inv(covariances), dtype=float)
        errors = np.array(self.errors)
        return known, inverse, inverse @ (_clipped(errors, points) if len(errors) else errors)

    def _covariances(self, one: _Situations, other: _Situations) -> FloatArray:
        """Return the covariances in s² of errors in n and m situations, shape (n, m)."""
        near = _kernel(one.points, other.points, self.signal, self.length)
        return np.asarray(near + one.reaches @ other.reaches.T)

    @cached_property
    def _parts(self) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
        """Of each part of a slope: the feature's column, both ends, deviation, reach of center."""
        bounds = [slope.bounds for slope in self.slopes]
        counts = [each.shape[1] for each in bounds]
        columns = [self.features.index(slope.feature) for slope in self.slopes]
        column = np.repeat(np.array(columns, dtype=np.intp), counts)
        ends = np.concatenate([np.empty((2, 0)), *bounds], axis=1)
        deviation = np.repeat([slope.deviation for slope in self.slopes], counts)
        center = self._center[column].clip(*ends)
        return column, ends, deviation, center

    def _situations(self, features: FloatArray) -> _Situations:
        column, ends, deviation, center = self._parts
        points = np.ascontiguousarray((features - self._center) / self._scale)
        reaches = deviation * (features.take(column, axis=1).clip(*ends) - center)
        return _Situations(points, reaches)

    @cached_property
    def _center(self) -> FloatArray:
        return np.array(self.center)

    @cached_property
    def _scale(self) -> FloatArray:
        return np.array(self.scale)


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


def errors_of_sums(
    expected: FloatArray, covariances: FloatArray, signs: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return `ErrorProcess.of_sum` for the result of `ErrorProcess.joint`."""
    variances = np.sum(signs @ covariances * signs, axis=-1)
    return signs @ expected, np.maximum(variances, 0.0)


def fit_error_process(
    prior: Mapping[str, Slope], features: FloatArray, errors: FloatArray
) -> ErrorProcess:
    """Return the process of greatest likelihood.

    Parameters
    ----------
    prior : mapping of str to Slope
        How durations are assumed to depend on each of the k features.
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
    shortest, longest = (length * np.sqrt(len(prior)) for length in _LENGTHS)
    least_ratio = _LEAST_SIGNAL_RATIO * math.sqrt(min(_FEW / count, 1.0))
    signal_bounds = ((least_ratio * spread) ** 2, (10.0 * spread) ** 2)
    signal = ConstantKernel(spread**2, signal_bounds)
    kernel = signal * Matern(0.5 * longest, (shortest, longest), nu=1.5)
    noise_bounds = (max(0.2 * spread, TIMING) ** 2, (3.0 * spread) ** 2)
    noise = WhiteKernel(spread**2, noise_bounds)
    with warnings.catch_warnings():  # results at a bound are intended
        warnings.simplefilter("ignore", ConvergenceWarning)
        process = GaussianProcessRegressor(kernel + noise).fit(points, _clipped(errors, points))
    found = process.kernel_.get_params()
    slopes = []
    for (name, slope), values in zip(prior.items(), features.T, strict=True):
        slopes += _unknown_slopes(name, slope, values)
    return ErrorProcess(
        tuple(prior),
        tuple(center.tolist()),
        tuple(scale.tolist()),
        tuple(map(tuple, points.tolist())),
        tuple(errors.tolist()),
        signal=float(np.sqrt(found["k1__k1__constant_value"])),
        noise=float(np.sqrt(found["k2__noise_level"])),
        length=float(found["k1__k2__length_scale"]),
        slopes=tuple(slopes),
    )


def _unknown_slopes(name: str, slope: Slope, values: FloatArray) -> list[UnknownSlope]:
    """Return the unknown slopes along a feature of which episodes have these values (n,).

    Slopes with bends are known where the next episodes are no farther apart than the bends. Beyond
    the first angle and the last one, turns to the other side are the next ones, as far away.
    """
    if not slope.bend:
        return [UnknownSlope(name, slope.deviation)]
    # Angles to the left and to the right reach half a turn, those that paths turn a whole turn.
    first = -math.pi if values.min() < -_NO_ANGLE else 0.0
    last = math.pi if values.max() <= math.pi else 2.0 * math.pi
    driven = np.sort(values.clip(first, last))
    ends = np.concatenate([[first], driven, [last]])
    apart = np.diff(ends)
    apart[[0, -1]] *= 2.0
    gaps = np.flatnonzero(apart > slope.bend)
    return [
        UnknownSlope(name, slope.deviation, (float(ends[at]), float(ends[at + 1])), slope.bend)
        for at in gaps
    ]


def robust_spread(errors: FloatArray) -> float:
    """Return the standard deviation of errors in s, robust against outliers; at least `TIMING`.

    It is the median absolute deviation, scaled as for a normal distribution.
    """
    deviations = np.abs(errors - np.median(errors))
    return max(1.4826 * float(np.median(deviations)), TIMING)


def _clipped(errors: FloatArray, points: FloatArray) -> FloatArray:
    """Return the errors (n,), clipped around the median of similar episodes."""
    count = min(_NEIGHBORS, len(errors))
    squares = np.square(points[:, None] - points).sum(axis=2)
    nearest = np.argpartition(squares, count - 1, axis=1)[:, :count]
    usual = np.median(errors[nearest], axis=1)
    most = _CLIPPED_AT * robust_spread(errors)
    return np.asarray(errors.clip(usual - most, usual + most))
