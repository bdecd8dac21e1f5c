"""Durations as a sum of rising functions of single features.

Each function is piecewise linear and never falls: a longer path, or a larger turn, takes no less
time. Its bends are thresholds and dead zones. In rules, a dead zone of 40° is a term such as
``0.0147*max(0, angle_to_dest - 40°)``. Slopes are those of the fastest path where drives do not
show them.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Container, Mapping, Sequence
from types import MappingProxyType

import numpy as np
import pandas as pd
from scipy.optimize import nnls

from ator_ros.geometry import BoolArray, FloatArray
from ator_ros.performance.error_process import TIMING, robust_spread
from ator_ros.performance.prior import Slope
from ator_ros.performance.tree.linear_models import corrected_error
from ator_ros.performance.tree.nodes import Hinge

_ANGLES: FloatArray = np.radians(
    [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 75.0, 90.0, 120.0, 150.0]
)
_TURN_ANGLES: FloatArray = np.radians(
    [*range(0, 60, 5), 60.0, 67.5, 75.0, 90.0, 105.0, 120.0, 135.0, 150.0]
)
"""Angles (rad) at which times of turns may bend.

They are finer than `_ANGLES`, those of whole durations, as times of turns vary less.
"""
RISING: dict[str, FloatArray] = {
    "dist": np.zeros(1),
    "angle_to_dest": _ANGLES,
    "angle_at_dest": _ANGLES,
}
"""Features that durations rise with, and where each may bend, in m and rad.

Thresholds are mostly small. The first feature is the distance, the last two are the turns before
and after the straight; the tables below have the same order.
"""
_EITHER_DIRECTION: dict[str, FloatArray] = {
    "dist": np.zeros(1),
    "dist_backward": np.zeros(1),
    "backward": np.zeros(1),
    "angle_to_straight": _ANGLES,
    "angle_after_straight": _ANGLES,
}
"""The same for an action that drives backward above an angle."""
OF_DIRECTION = tuple(name for name in _EITHER_DIRECTION if name not in RISING)
"""The features of either direction that others do not have."""
_ON_MAP: dict[str, FloatArray] = {
    "route_length": np.zeros(1),
    "route_turn": np.zeros(1),
    "route_angle_to": _ANGLES,
    "route_angle_at": _ANGLES,
}
"""Those of a domain with a map."""
_OF_PASSING: dict[str, FloatArray] = {
    "stopg": np.zeros(1),
    "rests": np.zeros(1),
    "moving_turn": _TURN_ANGLES,
}
"""Those that are added for an action that passes its goals, before the turns."""
# weight of a segment in the corrected error; more makes shorter rules, which refine less well
_TERM_COST = 0.75
# Now and then a drive takes much longer: residuals are clipped at so many standard deviations, and
# the fit is repeated.
_CLIPPED_AT = 3.0
_ROUNDS = 3
# s between the rows of drives: smaller residuals are never clipped, and lengths that differ by less
# than a robot drives in it show no slope
_SAMPLING = 0.1
# Share of the deviations of slopes of turns: straights depend less on the angles at their ends.
_OF_STRAIGHT = 0.1
_ROUNDING = 1e-9  # slopes, and ranges of segments, that are rounded zeros
# A segment is driven if so many drives reach so far into it, in rad, or half through it.
_DRIVES = 3
_REACH = math.radians(5.0)
# the fastest path does not depend on them
_NOT_OF_PATHS = ("dist_backward", "backward", "moving_turn")


def rising_in(names: Container[str]) -> dict[str, FloatArray]:
    """Return the features that durations rise with, and where each may bend.

    These are features of routes or of straights driven backward, if `names` has them, else
    `RISING`.
    """
    if "route_length" in names:
        rising = _ON_MAP
    else:
        rising = _EITHER_DIRECTION if "dist_backward" in names else RISING
    if "stopg" not in names:
        return rising
    distance, *others = rising.items()
    return dict([distance, *_OF_PASSING.items(), *others])


def sum_of(base: tuple[Hinge, ...], table: pd.DataFrame) -> FloatArray:
    """Return the sum of the terms in s, shape (n,), for features, shape (n, k)."""
    total = np.zeros(len(table))
    for hinge in base:
        total += hinge.of(table[hinge.feature].to_numpy())
    return total


def rising_terms(
    table: pd.DataFrame, parts: FloatArray, prior: Mapping[str, Slope]
) -> tuple[Hinge, ...]:
    """Return the terms that fit the durations of drives best, without the constant.

    The terms of each part are found alone: fifty drives then show beyond which angle an action
    turns on the spot, whatever else makes durations vary. A straight may take less time after a
    larger turn, as it begins with less of a curve, but the whole drive may not.

    Parameters
    ----------
    table : pandas.DataFrame
        The features `rising_in`.
    parts : array of float
        Times in s of the parts of each drive, shape (n, 3), see `part_times`, or its whole
        duration, shape (n, 1).
    prior : mapping of str to Slope
        How durations are assumed to depend on the features.
    """
    rising = dict(rising_in(table.columns))
    *_, first, last = rising
    expected = {name: prior[name] for name in rising}
    for name in _NOT_OF_PATHS:
        if name in expected:
            expected[name] = prior[name]._replace(time=0.0)
    slopes: Counter[_Bend] = Counter()
    whole = parts[:, 0]
    if parts.shape[1] > 1:
        first_turns, whole, last_turns = parts.T
        for name, times in ((first, first_turns), (last, last_turns)):
            slopes.update(_fitted(table, {name: _TURN_ANGLES}, times, expected))
            rising[name] = np.union1d(rising[name], [above for of, above in slopes if of == name])
            expected[name] = Slope(0.0, _OF_STRAIGHT * prior[name].deviation)
    slopes.update(_fitted(table, rising, whole, expected, turns=slopes))  # Counter.update adds
    terms = [Hinge(*bend, slope) for bend, slope in slopes.items() if abs(slope) > _ROUNDING]
    order = list(rising)
    terms.sort(key=lambda term: (order.index(term.feature), term.above))
    return tuple(terms)


_Bend = tuple[str, float]  # feature and place of a change of slope


def _fitted(
    table: pd.DataFrame,
    rising: dict[str, FloatArray],
    durations: FloatArray,
    expected: Mapping[str, Slope],
    turns: Mapping[_Bend, float] = MappingProxyType({}),
) -> dict[_Bend, float]:
    """Return the changes of slope that fit durations (n,) in s best.

    It is a least-squares fit on the segments between bends, with a further row for the slope
    `expected` of each. The sums of slopes and those of `turns` are not negative. Bends are removed,
    those first that are worth least, while the corrected error of M5' does not grow; none between
    segments that are driven and others.
    """
    by_feature = []
    begins: list[_Bend] = []
    groups: _Groups = []
    driven: list[bool] = []
    slopes_expected: list[float] = []
    deviations: list[float] = []
    least_noise: list[float] = []
    lowest: list[float] = []
    for name, bends in rising.items():
        segments = _segments(table[name].to_numpy(), bends)
        by_feature.append(segments)
        reaches = 0.5 * np.minimum(np.diff(bends, append=math.inf), 2.0 * _REACH)
        is_driven = np.count_nonzero(segments > reaches, axis=0) >= _DRIVES
        first = len(begins)
        begins += [(name, float(bend)) for bend in bends]
        driven += is_driven.tolist()
        groups.append(_runs(first, is_driven))
        slopes_expected += [expected[name].time] * len(bends)
        deviations += [expected[name].deviation] * len(bends)
        lowest += [
            -sum(slope for (of, above), slope in turns.items() if of == name and above <= bend)
            for bend in bends
        ]
        least_noise += [_SAMPLING if len(bends) == 1 else TIMING] * len(bends)
    all_segments = np.hstack(by_feature)
    centered = all_segments - all_segments.mean(axis=0)
    centered[:, np.ptp(all_segments, axis=0) < _ROUNDING] = 0.0  # else rounding errors get slopes
    target = durations - durations.mean()
    noise = _SAMPLING
    for _ in range(_ROUNDS):
        weights = np.maximum(noise, least_noise) / deviations
        rows = np.vstack([centered, np.diag(weights)])
        wanted = np.append(target, weights * slopes_expected)
        fitted = centered @ _bounded(rows, wanted, np.array(lowest))[0]
        error = target - fitted
        noise = robust_spread(error)
        most = max(_CLIPPED_AT * noise, _SAMPLING)
        target = fitted + np.clip(error, -most, most)
        target -= target.mean()
    # Fits to the rows of the triangular factor have the same squared errors; its last column is the
    # target.
    weights = np.maximum(noise, least_noise) / deviations
    rows = np.vstack([centered, np.diag(weights)])
    wanted = np.append(target, weights * slopes_expected)
    factor: FloatArray = np.asarray(np.linalg.qr(np.column_stack([rows, wanted]), mode="r"))
    error, slopes = _fit(groups, factor, len(target), lowest)
    while candidates := _merged(groups, driven):
        fits = [_fit(merged, factor, len(target), lowest) for merged in candidates]
        best = min(range(len(fits)), key=lambda number: fits[number][0])
        least, its_slopes = fits[best]
        if least[0] > error[0]:
            break
        error = least
        slopes = its_slopes
        groups = candidates[best]
    return _changes(begins, groups, slopes)


_Groups = list[list[list[int]]]  # by feature, the numbers of the segments that share a slope


def _segments(values: FloatArray, bends: FloatArray) -> FloatArray:
    """Return how far each value reaches into each segment, shape (n, segments)."""
    lengths = np.append(np.diff(bends), math.inf)
    return np.clip(values[:, None] - bends, 0.0, lengths)


def _runs(first: int, driven: BoolArray) -> list[list[int]]:
    """Return the segments of a feature, numbered from `first`: those not driven share a slope."""
    runs: list[list[int]] = []
    for number, is_driven in enumerate(driven.tolist()):
        if runs and not is_driven and not driven[number - 1]:
            runs[-1].append(first + number)
        else:
            runs.append([first + number])
    return runs


def _merged(groups: _Groups, driven: Sequence[bool]) -> list[_Groups]:
    """Return all groups that have one bend less than these, between driven segments."""
    found = []
    for number, runs in enumerate(groups):
        for at in range(len(runs) - 1):
            if not (driven[runs[at][0]] and driven[runs[at + 1][0]]):
                continue
            joined = runs[at] + runs[at + 1]
            merged = list(groups)
            merged[number] = [*runs[:at], joined, *runs[at + 2 :]]
            found.append(merged)
    return found


def _fit(
    groups: _Groups,
    factor: FloatArray,
    count: int,
    lowest: Sequence[float],
) -> tuple[tuple[float, float], FloatArray]:
    """Return corrected error (may be infinite) and plain error, to sort by, and the slopes."""
    all_runs = [run for runs in groups for run in runs]
    columns = [factor[:, run].sum(axis=1) for run in all_runs]
    table = np.column_stack(columns)
    lowest_of_runs = [max(lowest[segment] for segment in run) for run in all_runs]
    slopes, residual = _bounded(table, factor[:, -1], np.array(lowest_of_runs))
    terms = np.array([1.0 + _TERM_COST * len(slopes)])
    squared = np.array([residual**2])
    samples = np.array([float(count)])
    error = corrected_error(squared, samples, terms)
    return (float(error[0]), float(residual)), slopes


def _bounded(rows: FloatArray, wanted: FloatArray, lowest: FloatArray) -> tuple[FloatArray, float]:
    """Return the slopes of the least squared error, not below the lowest ones, and its root."""
    above, residual = nnls(rows, wanted - rows @ lowest)
    return above + lowest, residual


def _changes(
    begins: list[_Bend],
    groups: _Groups,
    slopes: FloatArray,
) -> dict[_Bend, float]:
    """Return the changes of slope; `begins` are feature and begin of each segment."""
    remaining = iter(slopes.tolist())
    changes = {}
    for runs in groups:
        before = 0.0
        for run in runs:
            slope = next(remaining)
            if slope != before:
                changes[begins[run[0]]] = slope - before
            before = slope
    return changes
