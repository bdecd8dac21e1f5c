"""Learning a gate from errors that are drawn for each chain from those of chains about as uncertain.

Of some hundred executed chains a handful become slower, and which ones is chance. By how much all of them
missed their predicted gain tells more about how often one becomes slower.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from ator_ros.evaluation.gate_learning import GateExamples, most_useful_threshold
from ator_ros.geometry import FloatArray
from ator_ros.refinement.gate import FEATURES, ThresholdGate

DRAWS = 100
"""Errors that are drawn of each chain: with few, chance decides between thresholds from 0.02 to 0.4 s."""
HARM = 2.0
"""As `ator_ros.evaluation.gate_learning.HARM`; less, as more chains become slower by drawn errors than do."""
_ALIKE = 0.1
"""Share of all chains, to either side by their predicted spread, among whose errors they are drawn.

In units of the spread errors are not alike: where little is predicted they exceed it, and were drawn far too
large for the others (on one robot 50 of 600 chains became slower so, where 6 did).
"""
_FEWEST = 5


def fit_to_drawn_errors(examples: GateExamples) -> ThresholdGate:
    """Return the most useful threshold for errors that are drawn, see `with_drawn_errors`."""
    return most_useful_threshold(with_drawn_errors(examples), harm=HARM)


def with_drawn_errors(examples: GateExamples) -> GateExamples:
    """Return each example `DRAWS` times, with errors drawn from those that are about as uncertain.

    An error is by how much a chain of the same kind missed its predicted gain, in s. They are drawn evenly,
    from the least to the greatest, not at random.
    """
    gain, spread = (examples.features[:, list(FEATURES).index(name)] for name in ("gain", "spread"))
    actual = examples.naive - examples.refined
    saved = np.tile(actual, (DRAWS, 1))
    for kind in np.unique(examples.kind):
        changed = (examples.kind == kind) & (gain > 0.0)
        if examples.succeeded is not None:
            changed &= examples.succeeded
        rows = np.flatnonzero(changed)
        rows = rows[np.argsort(spread[rows], kind="stable")]
        errors = actual[rows] - gain[rows]
        for place, row in enumerate(rows):
            saved[:, row] = gain[row] + _evenly(np.sort(_around(errors, place)))
    many = examples.part(np.tile(np.arange(len(gain)), DRAWS))
    return dataclasses.replace(many, refined=many.naive - saved.ravel())


def _evenly(errors: FloatArray) -> FloatArray:
    """Return `DRAWS` of sorted errors, evenly spaced by rank."""
    ranks = (np.arange(DRAWS) + 0.5) * (len(errors) / DRAWS)
    return errors[ranks.astype(np.intp)]


def _around(errors: FloatArray, place: int) -> FloatArray:
    """Return the errors to both sides of one, as many also at the ends."""
    beside = max(_FEWEST, round(_ALIKE * len(errors)))
    low = min(max(place - beside, 0), max(len(errors) - 2 * beside - 1, 0))
    return errors[low : low + 2 * beside + 1]
