"""Learning a gate from errors that are drawn for each chain from those of chains like it.

Of some hundred executed chains a handful become slower, and which ones is chance. By how much all of them
missed their predicted gain tells more about how often one becomes slower.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.stats import rankdata

from ator_ros.evaluation.gate_learning import GateExamples, most_useful_threshold
from ator_ros.geometry import FloatArray
from ator_ros.refinement.gate import FEATURES, ThresholdGate

DRAWS = 100
"""Errors that are drawn of each chain: with few, chance decides between thresholds from 0.02 to 0.4 s."""
_ALIKE = 0.2
"""Share of all chains among whose errors those of one are drawn: those with the most similar ranks of
predicted spread and predicted gain.

Errors grow with both. In units of the spread they are not alike: where little is predicted they exceed it.
And a chain that gains little has hardly changed, so its error is small: drawn without regard to the gain,
errors make two to three times as many chains slower as become so.
"""
_FEWEST = 10
LEAST = ThresholdGate(0.05, 0.25)
"""What a gate asks for at least: one control tick, and a quarter of the spread.

The errors of a few hundred chains tell little of rare ones. Gates of two robots that asked for less let 4 of
300 chains become slower each, with it 2 and 3.
"""


def fit_to_drawn_errors(examples: GateExamples) -> ThresholdGate:
    """Return the most useful threshold for errors that are drawn, see `with_drawn_errors`."""
    return most_useful_threshold(with_drawn_errors(examples), LEAST)


def with_drawn_errors(examples: GateExamples) -> GateExamples:
    """Return each example `DRAWS` times, with errors drawn from those of chains like it.

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
        errors, ranks = actual[rows] - gain[rows], rankdata([gain[rows], spread[rows]], axis=1)
        count = max(_FEWEST, round(_ALIKE * len(rows)))
        for place, row in enumerate(rows):
            apart = np.abs(ranks - ranks[:, place, None]).sum(axis=0)
            alike = np.argsort(apart, kind="stable")[:count]
            saved[:, row] = gain[row] + _evenly(np.sort(errors[alike]))
    many = examples.part(np.tile(np.arange(len(gain)), DRAWS))
    return dataclasses.replace(many, refined=many.naive - saved.ravel())


def _evenly(errors: FloatArray) -> FloatArray:
    """Return `DRAWS` of sorted errors, evenly spaced by rank."""
    ranks = (np.arange(DRAWS) + 0.5) * (len(errors) / DRAWS)
    return errors[ranks.astype(np.intp)]
