"""The objective: a weighted sum of measures, given with each request (paper, section 6)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.refinement import RefinementError

MEASURES = ("accuracy", "duration", "success")
"""Fields of a prediction that may have a weight: in m, in s, and a probability.

Its complement is the cost.
"""
LEAST_WEIGHT = 1e-6
MOST_WEIGHT = 1e6
"""Smaller or greater costs would be lost in rounding, or overflow, in a sum with others."""


@dataclass(frozen=True)
class Objective:
    """Weights of the measures; the cost of a chain is the weighted sum over its actions.

    The expected delay by being held up counts as the duration does, where it depends on the
    situation.

    Raises RefinementError for an unknown measure, for a weight that is neither 0 nor from
    LEAST_WEIGHT to MOST_WEIGHT, and if no weight is above 0.

    Attributes
    ----------
    weights : mapping
        Of "duration" without unit (seconds count as they are), of "success" in s per failure, of
        "accuracy" in s per m. By default only duration counts.
    where_predicted : frozenset of str
        Measures that count only for models that predict them; models must predict the others.
    """

    weights: Mapping[str, float] = field(default_factory=lambda: {"duration": 1.0})
    where_predicted: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        for name, weight in self.weights.items():
            if name not in MEASURES:
                raise RefinementError(
                    f"objective: expected measures of {list(MEASURES)}, got {name!r}"
                )
            if not (weight == 0.0 or LEAST_WEIGHT <= weight <= MOST_WEIGHT):
                raise RefinementError(
                    f"objective: expected a weight of {name} that is 0 or from {LEAST_WEIGHT:g} to "
                    f"{MOST_WEIGHT:g}, got {weight:g}"
                )
        if not self.needs:
            raise RefinementError("objective: expected at least one weight above 0, got none")

    @cached_property
    def needs(self) -> tuple[str, ...]:
        """The measures with a weight above 0."""
        return tuple(name for name, weight in self.weights.items() if weight)

    @property
    def of_unknown_uncertainty(self) -> tuple[str, ...]:
        """The required measures whose errors of prediction are unknown: all but duration."""
        return tuple(
            name for name in self.needs if name != "duration" and name not in self.where_predicted
        )

    def cost(self, prediction: Any) -> FloatArray:
        """Return the weighted cost, shape (n,), of a prediction for n candidates.

        Raises RefinementError if the model does not predict a measure with a weight. Those of
        `where_predicted` may be missing, unless they are all.
        """
        terms = []
        for name in self.needs:
            values = getattr(prediction, name, None)
            if name == "duration" and getattr(prediction, "delay", None) is not None:
                values = values + prediction.delay
            if values is not None:
                terms.append(self.weights[name] * (1.0 - values if name == "success" else values))
            elif name not in self.where_predicted or len(self.needs) == 1:
                raise RefinementError(f"objective: expected models that predict {name}, got none")
        return np.asarray(sum(terms[1:], start=terms[0]), dtype=float)


def expected_time(failure_cost: float) -> Objective:
    """Return the default objective: the duration, and the expected cost of failures.

    `failure_cost` is the time in s that one failure costs, such as the time limit of a chain. It
    counts for models that predict success.
    """
    return Objective({"duration": 1.0, "success": failure_cost}, frozenset({"success"}))
