"""Whether one model predicts records better than another by more than noise explains."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ator_ros.geometry import FloatArray

_DRAWS = 5000
_SEED = 0


@dataclass(frozen=True)
class Comparison:
    """Two models on the same records.

    Attributes
    ----------
    before, after : float
        Mean absolute errors in s of the model that is there, and of the other.
    chance : float
        Probability that the other would seem as much better if neither were: one-sided.
    """

    before: float
    after: float
    chance: float


def compare(before: FloatArray, after: FloatArray) -> Comparison:
    """Compare the errors (n,) in s of two models on the same records.

    Under the null hypothesis the signs of the differences are exchangeable: this is a sign-flip permutation
    test. It assumes no distribution, so that a few failed chains decide nothing.
    """
    gain = np.abs(before) - np.abs(after)
    signs = np.random.default_rng(_SEED).choice((-1.0, 1.0), (_DRAWS, len(gain)))
    drawn = signs @ gain
    chance = (1.0 + float(np.sum(drawn >= gain.sum() - 1e-12))) / (_DRAWS + 1.0)
    return Comparison(float(np.mean(np.abs(before))), float(np.mean(np.abs(after))), chance)
