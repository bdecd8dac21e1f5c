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
        Mean losses of the model that is there, and of the other.
    chance : float
        Probability that the other, or any that was compared beside it, would seem as much better if none
        were: one-sided.
    """

    before: float
    after: float
    chance: float


def compare(before: FloatArray, after: FloatArray) -> list[Comparison]:
    """Compare the losses of a model with those of others on the same records.

    Under the null hypothesis the signs of the differences are exchangeable: this is a sign-flip permutation
    test. It assumes no distribution, so that a few failed chains decide nothing. All others are compared with
    the same signs (Westfall and Young 1993): the greatest of their statistics is what the chance is of, and
    many that resemble each other cost no more than one.

    Parameters
    ----------
    before : ndarray, shape (n,)
        Losses of the model that is there, at least 0.
    after : ndarray, shape (n, k)
        Those of the others.
    """
    gain = before[:, None] - after
    gain = gain / np.maximum(np.sqrt(np.sum(gain * gain, axis=0)), 1e-12)
    signs = np.random.default_rng(_SEED).choice((-1.0, 1.0), (_DRAWS, len(gain)))
    greatest = np.max(signs @ gain, axis=1)
    beyond = np.sum(greatest[:, None] >= gain.sum(axis=0) - 1e-12, axis=0)
    chances = (1.0 + beyond) / (_DRAWS + 1.0)
    return [
        Comparison(float(np.mean(before)), float(np.mean(losses)), float(chance))
        for losses, chance in zip(after.T, chances, strict=True)
    ]
