"""Averages of costs over neighbouring candidates, so that a choice does not follow single errors.

A search prefers candidates whose cost is predicted too low. Where models err by as much as candidates differ,
and neighbours err independently, the mean over neighbours is the better guess (kernel regression after
Nadaraya and Watson, with a normal kernel). But a mean hides steps, which are real where a manoeuvre barely
fits. So a candidate counts as what is predicted for it or as the mean of its neighbours, whichever is more.
How wide the kernel should be depends on the models, so their gate says it. Where the steps of a grid are
wider than the kernel, its candidates have no neighbours.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.tops.ranges import Range

Widths = Mapping[str, float]
"""Goal variable to the standard deviation of its kernel, in its unit; a variable without one has none."""


@dataclass(frozen=True, slots=True)
class Averages:
    """How the candidates of each subgoal are averaged.

    Attributes
    ----------
    axes : sequence, one item per subgoal
        Domains of the subgoal's k free variables.
    widths : sequence, one item per subgoal
        Widths of the same variables; candidates that differ in one of width 0 are no neighbours.
    """

    axes: Sequence[Sequence[Range]]
    widths: Sequence[Sequence[float]]

    def weights(self, index: int, candidates: FloatArray) -> FloatArray | None:
        """Return the weights of all candidates (n, k) of a subgoal in the mean of each, shape (n, n).

        None where nothing is averaged.
        """
        if len(candidates) == 1 or not any(self.widths[index]):
            return None
        exponent = np.zeros((len(candidates), len(candidates)))
        for values, domain, width in zip(candidates.T, self.axes[index], self.widths[index], strict=True):
            apart = np.abs(values[:, None] - values)
            if domain.periodic:
                apart %= domain.high - domain.low  # what is given may be turns away
                apart = np.minimum(apart, (domain.high - domain.low) - apart)
            exponent += (apart / width) ** 2 if width else np.where(apart > 0.0, np.inf, 0.0)
        weights: FloatArray = np.exp(-0.5 * exponent)
        return weights


def averaged(cost: FloatArray, before: FloatArray | None, after: FloatArray | None) -> FloatArray:
    """Return the cost of a step for n candidates before and m after it: the mean over both, or more.

    Parameters
    ----------
    cost : ndarray, shape (n, m)
        Where it is above the mean it stays. What is infinite is left out of its neighbours' means.
    before, after : ndarray, shapes (n, n) and (m, m), or None
        Weights; None where nothing is averaged.
    """
    finite = np.isfinite(cost)
    sums, weights = np.where(finite, cost, 0.0), finite.astype(float)
    if before is not None:
        sums, weights = before @ sums, before @ weights
    if after is not None:
        sums, weights = sums @ after.T, weights @ after.T
    means = sums / np.where(finite, weights, 1.0)
    return np.maximum(cost, means)
