"""A gate's threshold from errors that are drawn for each chain."""

from __future__ import annotations

import numpy as np
import pytest

from ator_ros.evaluation.gate_learning import (
    DRAWS,
    LEAST,
    GateExamples,
    compare_gates,
    fit_to_drawn_errors,
    with_drawn_errors,
)
from ator_ros.refinement.gate import FEATURES


def test_drawn_errors_keep_what_was_saved_and_leave_what_was_not_changed() -> None:
    rng = np.random.default_rng(5)
    gain, spread = (
        np.where(np.arange(400) % 4 == 0, 0.0, rng.uniform(0.1, 2.0, 400)),
        rng.uniform(0.2, 1.0, 400),
    )
    kind = np.arange(400) // 200
    width = np.where(kind == 0, 0.1, 0.9)
    saved = np.where(gain > 0.0, gain + width * spread * rng.standard_normal(400), 0.0)
    features = np.zeros((400, len(FEATURES)))
    features[:, list(FEATURES).index("gain")] = gain
    features[:, list(FEATURES).index("spread")] = spread
    naive = np.full(400, 10.0)
    examples = GateExamples(features, naive, naive - saved, np.arange(400), kind)
    drawn = with_drawn_errors(examples)
    assert len(drawn.naive) == DRAWS * 400
    again = drawn.naive - drawn.refined
    assert not again[np.tile(gain == 0.0, DRAWS)].any()
    assert again.mean() == pytest.approx(saved.mean(), abs=0.02)
    assert again.std() == pytest.approx(saved.std(), abs=0.02)
    calm = np.tile(kind == 0, DRAWS)
    assert np.abs(again - np.tile(gain, DRAWS))[calm].max() < 0.5


def test_what_hardly_changes_is_not_given_the_errors_of_what_changes_much() -> None:
    """Both are of the same spread, as leaves have it, whether two chains use the same ones or not."""
    rng = np.random.default_rng(8)
    gain = rng.uniform(0.02, 3.0, 600)
    errors = 0.3 * gain * rng.standard_normal(600)
    features = np.zeros((600, len(FEATURES)))
    features[:, list(FEATURES).index("gain")] = gain
    features[:, list(FEATURES).index("spread")] = rng.uniform(0.3, 0.31, 600)
    naive = np.full(600, 10.0)
    examples = GateExamples(features, naive, naive - gain - errors, np.arange(600), np.zeros(600, dtype=int))
    drawn = with_drawn_errors(examples)
    error = (drawn.naive - drawn.refined - np.tile(gain, DRAWS)).reshape(DRAWS, 600)
    assert error[:, gain < 0.3].std() < 0.5 * error.std()
    assert error[:, gain > 2.5].std() > 1.2 * error.std()


@pytest.mark.parametrize(
    ("spread", "naive", "refined", "failed"), [(0.3, 10.0, 1.0, True), (0.0, 10.0, 9.0, False)]
)
def test_one_odd_chain_does_not_decide_what_errors_are_drawn(
    spread: float, naive: float, refined: float, failed: bool
) -> None:
    """One that failed after a second looks like a gain; one without any spread has a huge error for it."""
    rng = np.random.default_rng(8)
    gain, spreads = rng.uniform(0.1, 3.0, 300), np.full(300, 0.3)
    saved = gain + 0.1 * rng.standard_normal(300)
    times = np.full(300, 10.0)
    odd = times - saved
    gain[0], spreads[0], times[0], odd[0] = 1.02, spread, naive, refined
    features = np.zeros((300, len(FEATURES)))
    features[:, list(FEATURES).index("gain")], features[:, list(FEATURES).index("spread")] = gain, spreads
    examples = GateExamples(
        features,
        times,
        odd,
        np.arange(300),
        np.zeros(300, dtype=int),
        np.arange(300) != 0 if failed else None,
    )
    drawn = with_drawn_errors(examples)
    rest = np.tile(np.arange(300) != 0, DRAWS)
    error = (drawn.naive - drawn.refined)[rest] - np.tile(gain, DRAWS)[rest]
    assert np.abs(error).max() < 0.6


def test_errors_that_do_not_grow_with_the_spread_are_not_made_to() -> None:
    rng = np.random.default_rng(3)
    spread, gain = rng.choice([0.02, 1.5], 600), rng.uniform(0.1, 3.0, 600)
    saved, naive = gain + 0.1 * rng.standard_normal(600), np.full(600, 10.0)
    features = np.zeros((600, len(FEATURES)))
    features[:, list(FEATURES).index("gain")], features[:, list(FEATURES).index("spread")] = gain, spread
    examples = GateExamples(features, naive, naive - saved, np.arange(600), np.zeros(600, dtype=int))
    drawn = with_drawn_errors(examples)
    error = (drawn.naive - drawn.refined) - np.tile(gain, DRAWS)
    assert error.std() == pytest.approx((saved - gain).std(), rel=0.1)
    gate = fit_to_drawn_errors(examples)
    assert gate.spread_factor == LEAST.spread_factor


def test_gates_from_drawn_errors_are_compared_on_the_chains_as_they_were_executed() -> None:
    rng = np.random.default_rng(2)
    gain = rng.uniform(0.1, 3.0, 100)
    features = np.zeros((100, len(FEATURES)))
    features[:, list(FEATURES).index("gain")], features[:, list(FEATURES).index("spread")] = gain, 0.3
    naive = np.full(100, 10.0)
    examples = GateExamples(features, naive, naive - gain, np.arange(100), np.zeros(100, dtype=int))
    compared = compare_gates(examples, fit_to_drawn_errors)
    assert all(sum(row[name] for name in ("higher", "equal", "lower")) == 100 for row in compared.values())
