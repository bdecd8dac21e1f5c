"""Learning a gate from errors that are drawn for each chain, as large as those of all.

Of some hundred executed chains a handful become slower, and which ones is chance. By how much all of them
missed their predicted gain, in units of the predicted spread, tells more about how often one becomes slower.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from ator_ros.evaluation.gate_learning import GateExamples, fit_threshold
from ator_ros.refinement.gate import FEATURES, ThresholdGate

DRAWS = 20
"""Errors that are drawn of each chain: with one, chance decides between thresholds from 0.02 to 0.4 s."""
KEPT_OF_DRAWN = 0.95
"""As `ator_ros.evaluation.gate_learning.KEPT`, of the gain with drawn errors."""
_LEAST_SPREAD = 0.2  # of the usual one, by which errors are divided


def fit_to_drawn_errors(examples: GateExamples, *, seed: int) -> ThresholdGate:
    """Return the threshold for errors that are drawn, see `with_drawn_errors`."""
    return fit_threshold(with_drawn_errors(examples, seed=seed), keep=KEPT_OF_DRAWN)


def with_drawn_errors(examples: GateExamples, *, seed: int) -> GateExamples:
    """Return each example `DRAWS` times, with errors drawn from those of all of its kind.

    An error is by how much a chain missed its predicted gain, in units of its predicted spread.
    """
    gain, spread = (examples.features[:, list(FEATURES).index(name)] for name in ("gain", "spread"))
    usual = float(np.median(spread[spread > 0.0])) if (spread > 0.0).any() else 1.0
    sure, rng = np.maximum(spread, _LEAST_SPREAD * usual), np.random.default_rng(seed)
    saved = np.tile(examples.naive - examples.refined, (DRAWS, 1))
    for kind in np.unique(examples.kind):
        changed = (examples.kind == kind) & (gain > 0.0)
        if examples.succeeded is not None:
            changed &= examples.succeeded
        errors = (saved[0, changed] - gain[changed]) / sure[changed]
        saved[:, changed] = gain[changed] + sure[changed] * rng.choice(errors, (DRAWS, len(errors)))
    many = examples.part(np.tile(np.arange(len(gain)), DRAWS))
    return dataclasses.replace(many, refined=many.naive - saved.ravel())
