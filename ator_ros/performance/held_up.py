"""Drives that were held up: the way was blocked, or the server waited and tried again.

Such a drive takes far longer than all similar ones, so the features cannot explain it. It is no
example of how long the action takes, and is described apart.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Annotated

import numpy as np

from ator_ros.geometry import BoolArray, FloatArray
from ator_ros.schema import Within

LEAST_RATIO = 1.5
LEAST_DELAY = 2.0
"""A drive that was held up takes at least this multiple of similar ones, and so much longer, in s.

Errors reach ratios of 1.4 of undisturbed drives, and 1.4 s of short drives.
"""
# Twice as long needs less delay.
_SURE_RATIO = 2.0
_SURE_DELAY = 1.5
# Some drives vary more. Then the least ratio is a power of that which this share of usual drives
# keeps. Few drives do not show it, so it has a limit.
_SHARE_OF_USUAL = 0.95
_POWER = 4.0
_MOST_RATIO = 2.5
# An action that does not follow its path, such as a shot, may take several attempts.
_RATIO_OF_ATTEMPTS = 3.0
# A drive that is left out already needs less to remain so, or the choice would alternate.
_TO_REMAIN = 0.5
_MOST_SHARE = 1.0 / 3.0  # of drives that are held up; more are how the action drives
# s added to both durations of a ratio: a turn of 0.1 s may take 0.2 s
_SHORT = 0.5
# A drive counts for the first model with at most this multiple of what it usually takes, which is
# more than hard drives differ from easy ones, and less than most delays.
_CLIPPED_AT = 2.5
_KEPT = 0.9  # share of drives that keep a bound
_MOST_EXPECTED = 0.5  # share of drives that are held up in a situation, as `HeldUp` allows
_MOST_KEPT = 0.999  # of those that are not held up; more would assume that errors are normal
_HALVINGS = 40  # of an interval: what is left of the longest delay is far below a control tick
_LEAST_SPREAD = 1e-6  # s; a normal distribution needs some
_LEAST_TIME = 0.05  # s, least time of a path in such a multiple


@dataclass(frozen=True)
class HeldUp:
    """How often, and how long, drives were held up.

    Attributes
    ----------
    share : float
        Share of the drives that succeeded.
    delay : float
        Mean of their durations less those predicted, in s.
    drives : int
        Their number.
    late : float
        Nine of ten drives, held up or not, took at most so many s longer than predicted; 0 if none
        was held up.
    """

    share: Annotated[float, Within(0.0, _MOST_EXPECTED)] = 0.0
    delay: Annotated[float, Within(0.0)] = 0.0
    drives: Annotated[int, Within(0)] = 0
    late: float = 0.0

    def bound(
        self, durations: FloatArray, spreads: FloatArray, delays: FloatArray | None = None
    ) -> FloatArray:
        """Return what nine of ten drives take at most, shape (n,), in s.

        Parameters
        ----------
        durations, spreads : ndarray, shape (n,)
            Predicted durations in s, and standard deviations in s of undisturbed drives.
        delays : ndarray, shape (n,), optional
            Expected delays in s, if they depend on the situation.
        """
        if delays is not None and self.delay > 0.0:
            usual = durations + NormalDist().inv_cdf(_KEPT) * spreads
            is_often = delays > (1.0 - _KEPT) * self.delay
            return np.asarray(usual + np.where(is_often, self.delay, 0.0))
        quantile = min(_KEPT / (1.0 - self.share), _MOST_KEPT)
        deviations = NormalDist().inv_cdf(quantile)
        return np.asarray(durations + np.maximum(self.late, deviations * spreads))

    def where_expected(self, delay: float | None) -> HeldUp:
        """Return it for a situation with an expected delay in s; None: like any other."""
        if delay is None or self.delay == 0.0:
            return self
        return dataclasses.replace(self, share=min(delay / self.delay, _MOST_EXPECTED))


NOT_HELD_UP = HeldUp()
"""If no drive was held up."""


def bound_of_chain(duration: float, spread: float, held_up: Sequence[HeldUp]) -> float:
    """Return what nine of ten runs of a chain take at most, in s.

    Its drives are held up independently of each other, each for the mean delay: so often as in a
    Poisson process.

    Parameters
    ----------
    duration, spread : float
        Expected duration in s if no drive is held up, and the standard deviation of actual ones.
    held_up : sequence of HeldUp
        One for each drive.
    """
    expected = math.fsum(each.share for each in held_up)
    total = math.fsum(each.share * each.delay for each in held_up)
    usual = NormalDist(duration, max(spread, _LEAST_SPREAD))
    if expected == 0.0:
        return usual.inv_cdf(_KEPT)
    delay = total / expected

    def share_kept(bound: float) -> float:
        share = 0.0
        chance = math.exp(-expected)
        for count in range(len(held_up) + 1):
            share += chance * usual.cdf(bound - count * delay)
            chance *= expected / (count + 1)
        return share

    low = usual.inv_cdf(_KEPT)
    high = low + len(held_up) * delay
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if share_kept(middle) < _KEPT:
            low = middle
        else:
            high = middle
    return high


def clipped(durations: FloatArray, path_times: FloatArray) -> FloatArray:
    """Return durations (n,) in s that no single drive makes much longer.

    A first model is learned from them. Hard drives remain longer than easy ones, so that a model
    can explain them.

    Parameters
    ----------
    durations : array of float, shape (n,)
        Durations of drives in s.
    path_times : array of float, shape (n,)
        Times in s of their fastest paths.
    """
    fastest = np.maximum(path_times, _LEAST_TIME)
    usual = float(np.median(durations / fastest))
    return np.minimum(durations, _CLIPPED_AT * (usual * fastest + _SHORT))


def find_held_up(
    durations: FloatArray, predicted: FloatArray, left_out: BoolArray, *, follows_path: bool = True
) -> BoolArray:
    """Return which drives were held up, shape (n,).

    Parameters
    ----------
    durations : array of float, shape (n,)
        Durations of drives in s.
    predicted : array of float, shape (n,)
        What a model predicts that was learned without the drive.
    left_out : array of bool, shape (n,)
        Which drives the model was learned without, as they seemed to be held up.
    follows_path : bool
        Whether the action follows its path, so that its durations vary little.
    """
    predicted = np.maximum(predicted, 0.0)
    longer = np.log((durations + _SHORT) / (predicted + _SHORT))
    longer -= np.median(longer)
    low, high = np.log((LEAST_RATIO, _MOST_RATIO))
    tail = float(np.quantile(longer[longer <= low], _SHARE_OF_USUAL))
    least = np.clip(_POWER * tail, low, high) if follows_path else np.log(_RATIO_OF_ATTEMPTS)
    found = longer > np.where(left_out, _TO_REMAIN, 1.0) * least
    delays = durations - predicted
    is_sure = (longer > np.log(_SURE_RATIO)) & (delays > _SURE_DELAY)
    found &= is_sure | (delays > LEAST_DELAY)
    return np.asarray(found & (found.mean() <= _MOST_SHARE))


def describe_held_up(errors: FloatArray, held: BoolArray) -> HeldUp:
    """Return how often drives were held up, and how long.

    `errors` (n,) are actual less predicted durations in s, `held` (n,) those that were held up.
    """
    if not held.any():
        return NOT_HELD_UP
    delay = float(errors[held].mean())
    late = float(np.quantile(errors, _KEPT))
    return HeldUp(float(held.mean()), max(delay, 0.0), int(held.sum()), late)


def held_up_remark(action: str, held_up: HeldUp) -> list[str]:
    """Return a remark on the drives of an action that were held up, if there are any."""
    if not held_up.drives:
        return []
    were = "drive was" if held_up.drives == 1 else "drives were"
    share = f"{100.0 * held_up.share:.2g} %"
    return [
        f"{action}: {held_up.drives} {were} held up ({share}), by {held_up.delay:.1f} s on "
        "average: durations are learned from the others"
    ]
