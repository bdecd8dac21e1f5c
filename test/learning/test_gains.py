"""The measured gain of refined chains, and the gate that uses it."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import ttest_ind

from ator_interfaces.msg import ChainPerformance, Outcome
from ator_ros.files import FileError
from ator_ros.learning.gains import GAINS, ChainGain, Gains, add_chains, chain_gain, read_gains
from ator_ros.refinement.gate import Gate


def executed(gained: float, *, refined: int = 30, compared: int = 6) -> Gains:
    """Return chains that were predicted to gain 0.7 s, and gained `gained` (s) on average."""
    rng = np.random.default_rng(3)
    chains = [
        ChainGain(True, 0.7, 0.7 - gained + 0.2 + rng.normal(0.0, 0.3)) for _ in range(refined)
    ]
    chains += [ChainGain(False, 0.7, 0.2 + rng.normal(0.0, 0.3)) for _ in range(compared)]
    return Gains("", tuple(chains))


@pytest.mark.parametrize("gained", [-0.7, 0.0, 0.6])
def test_the_measured_gain_is_that_of_the_chains(gained: float) -> None:
    measured = executed(gained).measured
    assert measured.low < gained < measured.high
    assert measured.mean == pytest.approx(gained, abs=0.3)
    assert f"{measured.mean:.2f} s" in str(measured)


def test_the_gate_closes_where_the_predicted_gain_does_not_materialize() -> None:
    closed = Gate(measured=executed(-0.7).measured)
    refine, reason = closed.decide(0.7, 0.2)
    assert not refine
    assert reason.startswith("gain 0.70 s ± 0.20 s: kept naive, as the measured gain is ")
    assert reason.endswith("the gate is closed")
    for gains in (executed(0.6), executed(-0.7, refined=5, compared=2), Gains()):
        assert Gate(measured=gains.measured).decide(0.7, 0.2) == (
            True,
            "gain 0.70 s ± 0.20 s: refined",
        )


def test_the_share_of_comparison_chains_decreases() -> None:
    shares = [
        executed(0.5, refined=count, compared=0).comparison_share(0.1)
        for count in (0, 49, 199, 499)
    ]
    assert shares == pytest.approx([0.1, 0.1, 0.05, 0.0316], abs=1e-4)


def test_gains_are_kept_by_set_and_a_damaged_file_is_reported(tmp_path: Path) -> None:
    gains = add_chains(tmp_path, read_gains(tmp_path, "a"), ChainGain(True, 0.5, 0.1))
    assert read_gains(tmp_path, "a") == gains
    assert read_gains(tmp_path, "b") == Gains("b")
    gains = add_chains(tmp_path, gains, ChainGain(True, 0.5, 0.1, "bezier"))
    assert [name.rpartition(" ")[2] for name in gains.diagnostics()] == ["default", "bezier"]
    (tmp_path / GAINS).write_text('{"format": "ator_ros gains of refinement"', encoding="utf-8")
    with pytest.raises(FileError, match=GAINS):
        read_gains(tmp_path, "a")


def test_only_chains_that_ran_as_predicted_count() -> None:
    def record(
        *, refined: bool = True, comparison: bool = False, fetched: int = 0
    ) -> ChainPerformance:
        message = ChainPerformance(
            refined=refined, fetched=fetched, outcome=Outcome(code=Outcome.SUCCEEDED)
        )
        message.gain.models = "a"
        message.gain.predicted, message.gain.comparison = 0.5, comparison
        message.predicted.duration, message.actual.duration = 9.0, 9.2
        return message

    chain = chain_gain(record(), "a")
    assert (chain.refined, chain.gain, chain.excess) == (True, 0.5, pytest.approx(0.2))
    compared = chain_gain(record(refined=False, comparison=True), "a")
    assert not compared.refined
    assert chain_gain(record(refined=False), "a") is None
    assert chain_gain(record(fetched=1), "a") is None
    assert chain_gain(record(), "b") is None


def test_the_interval_is_that_of_the_difference_of_two_means() -> None:
    gains = executed(0.6, refined=8, compared=3)
    refined = [chain.gain - chain.excess for chain in gains.chains if chain.refined]
    naive = [-chain.excess for chain in gains.chains if not chain.refined]
    welch = ttest_ind(refined, naive, equal_var=False).confidence_interval(0.95)
    measured = gains.measured
    assert (measured.low, measured.high) == pytest.approx((welch.low, welch.high))
    assert measured.mean == pytest.approx(np.mean(refined) - np.mean(naive))
    assert measured.predicted == pytest.approx(0.7)


@pytest.mark.parametrize(("refined", "compared"), [(1, 5), (5, 1), (0, 0)])
def test_two_chains_of_each_kind_are_needed(refined: int, compared: int) -> None:
    measured = executed(0.6, refined=refined, compared=compared).measured
    assert math.isnan(measured.mean)
    assert (measured.refined, measured.compared) == (refined, compared)


def test_chains_without_variance_have_an_exact_gain() -> None:
    chains = [ChainGain(True, 0.7, 0.2)] * 3 + [ChainGain(False, 0.7, 0.1)] * 3
    measured = Gains("", tuple(chains)).measured
    assert (measured.mean, measured.low, measured.high) == pytest.approx((0.6, 0.6, 0.6))


def test_the_newest_500_chains_are_kept(tmp_path: Path) -> None:
    old = ChainGain(True, 0.1, 0.0)
    gains = add_chains(tmp_path, Gains("a", (old,) * 499), ChainGain(True, 0.2, 0.0))
    assert len(gains.chains) == 500
    gains = add_chains(tmp_path, gains, ChainGain(True, 0.3, 0.0))
    assert len(gains.chains) == 500
    assert [chain.gain for chain in gains.chains[-3:]] == [0.1, 0.2, 0.3]
    assert read_gains(tmp_path, "a") == gains


@pytest.mark.parametrize("field", ["failed", "refined_again", "unknown gain", "endless"])
def test_chains_that_predictions_do_not_cover_do_not_count(field: str) -> None:
    message = ChainPerformance(refined=True, outcome=Outcome(code=Outcome.SUCCEEDED))
    message.gain.models = "a"
    assert chain_gain(message, "a") is not None
    if field == "failed":
        message.outcome.code = Outcome.FAILED
    elif field == "refined_again":
        message.refined_again = 1
    elif field == "unknown gain":
        message.gain.predicted = math.nan
    else:
        message.actual.duration = 2e6
    assert chain_gain(message, "a") is None
