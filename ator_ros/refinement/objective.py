"""What shall be least: weighted measures of performance, combined at request time (paper, section 6)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.refinement import RefinementError

MEASURES = ("accuracy", "duration", "success")
"""Fields of a prediction that may have a weight: m, s, and a probability, of which its complement costs."""
LEAST_WEIGHT, MOST_WEIGHT = 1e-6, 1e6
"""Costs that are smaller or greater would drown in rounding, or overflow, beside others."""


@dataclass(frozen=True)
class Objective:
    """Weights of the measures; the cost of a chain is the weighted sum over its actions.

    Attributes
    ----------
    weights : mapping
        Of "duration" without unit (seconds count as they are), of "success" in s per failure, of "accuracy"
        in s per m. By default only duration counts.
    where_predicted : frozenset of str
        Measures that count only for models that predict them; models must predict the others.

    Raises
    ------
    RefinementError
        An unknown measure, a weight that is neither 0 nor from LEAST_WEIGHT to MOST_WEIGHT, or no weight
        above 0.
    """

    weights: Mapping[str, float] = field(default_factory=lambda: {"duration": 1.0})
    where_predicted: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        for name, weight in self.weights.items():
            if name not in MEASURES:
                raise RefinementError(f"objective: expected measures of {list(MEASURES)}, got {name!r}")
            if not (weight == 0.0 or LEAST_WEIGHT <= weight <= MOST_WEIGHT):
                raise RefinementError(
                    f"objective: expected a weight of {name} that is 0 or from {LEAST_WEIGHT:g} to "
                    f"{MOST_WEIGHT:g}, got {weight:g}"
                )
        if not self.needs:
            raise RefinementError("objective: expected at least one weight above 0, got none")

    @cached_property
    def needs(self) -> tuple[str, ...]:
        """The measures that count."""
        return tuple(name for name, weight in self.weights.items() if weight)

    def cost(self, prediction: Any) -> FloatArray:
        """Return the weighted cost, shape (n,), of a prediction for n candidates.

        Raises
        ------
        RefinementError
            The performance model does not predict a measure that has a weight and is not among
            `where_predicted`, or no measure that has a weight.
        """
        terms = []
        for name in self.needs:
            values = getattr(prediction, name, None)
            if values is not None:
                terms.append(self.weights[name] * (1.0 - values if name == "success" else values))
            elif name not in self.where_predicted or len(self.needs) == 1:
                raise RefinementError(f"objective: expected models that predict {name}, got none")
        return np.asarray(sum(terms[1:], start=terms[0]), dtype=float)


def expected_time(failure_cost: float) -> Objective:
    """Return the default objective: the duration, and what failing is expected to cost.

    Parameters
    ----------
    failure_cost : float
        Time in s that one failure costs, such as the time limit of a chain; only for models that predict it.
    """
    return Objective({"duration": 1.0, "success": failure_cost}, frozenset({"success"}))
