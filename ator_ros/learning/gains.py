"""The measured gain of refined chains, compared with chains that ran naive."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from scipy.special import stdtrit

from ator_ros.actions import DEFAULT_SET
from ator_ros.files import load, save
from ator_ros.refinement.gate import MeasuredGain
from ator_ros.schema import Within

GAINS = "gains.json"
KIND = "gains of refinement"
_MOST = 500  # newest chains that count
_LONGEST = 1e6  # s; sums of squares of greater numbers would overflow
# chains up to which the share of comparisons is greatest; then it falls with their root
_FULL_SHARE = 50

Seconds = Annotated[float, Within(-_LONGEST, _LONGEST)]


@dataclass(frozen=True)
class ChainGain:
    """One executed chain, refined or naive.

    Attributes
    ----------
    gain : float
        Predicted gain in s of refinement.
    excess : float
        Measured less predicted duration in s of the chain as it was executed.
    """

    refined: bool
    gain: Seconds
    excess: Seconds
    action_set: str = DEFAULT_SET


@dataclass(frozen=True)
class Gains:
    """The chains executed with one set of models, oldest first; `models` is its digest."""

    models: str = ""
    chains: tuple[ChainGain, ...] = ()

    def of(self, action_set: str) -> Gains:
        """Return the chains of an action set."""
        return replace(
            self, chains=tuple(chain for chain in self.chains if chain.action_set == action_set)
        )

    def diagnostics(self) -> dict[str, str]:
        """Return the diagnostics: the measured gain of each action set."""
        sets = dict.fromkeys((DEFAULT_SET, *(chain.action_set for chain in self.chains)))
        return {
            f"measured gain per refined chain of {name}": str(self.of(name).measured)
            for name in sets
        }

    def comparison_share(self, greatest: float) -> float:
        """Return the probability with which the next chain runs naive, at most `greatest`."""
        return greatest * min(1.0, math.sqrt(_FULL_SHARE / (len(self.chains) + 1)))

    @cached_property
    def measured(self) -> MeasuredGain:
        """The mean gain of refined chains.

        Predictions of both kinds of chains have errors, and the difference of these is subtracted.
        The interval is that of the difference of two means (Welch).
        """
        refined = [chain for chain in self.chains if chain.refined]
        compared = np.array([chain.excess for chain in self.chains if not chain.refined])
        predicted = float(np.mean([chain.gain for chain in refined])) if refined else math.nan
        gained = np.array([chain.gain - chain.excess for chain in refined])
        if min(len(gained), len(compared)) < 2:
            return MeasuredGain(len(gained), len(compared), predicted)
        mean = float(gained.mean() + compared.mean())
        parts = [
            (float(each.var(ddof=1)) / len(each), len(each) - 1) for each in (gained, compared)
        ]
        variance = sum(part for part, _ in parts)
        freedom = variance**2 / max(sum(part**2 / count for part, count in parts), 1e-12)
        half = float(stdtrit(max(freedom, 1.0), 0.975)) * math.sqrt(variance)
        return MeasuredGain(len(gained), len(compared), predicted, mean, mean - half, mean + half)


def chain_gain(record: Any, models: str) -> ChainGain | None:
    """Return the gain of a chain from its ChainPerformance; None if it does not count.

    A chain counts if it was refined, or ran naive for comparison, with the models of this
    digest, and succeeded without events that predictions do not cover.
    """
    gain = record.gain
    counts = record.refined or gain.comparison
    excess = record.actual.duration - record.predicted.duration
    succeeded = record.outcome.code == record.outcome.SUCCEEDED
    undisturbed = succeeded and not (record.fetched or record.refined_again)
    if not (counts and undisturbed and gain.models == models):
        return None
    if not (abs(gain.predicted) <= _LONGEST and abs(excess) <= _LONGEST):  # nor NaN
        return None
    return ChainGain(
        not gain.comparison, gain.predicted, excess, record.chain.action_set or DEFAULT_SET
    )


def read_gains(folder: Path, models: str) -> Gains:
    """Return the chains executed with a set of models, if the file has any.

    FileError: it is damaged.
    """
    if not (folder / GAINS).exists():
        return Gains(models)
    gains = load(folder / GAINS, KIND, Gains)
    return gains if gains.models == models else Gains(models)


def add_chains(folder: Path, gains: Gains, *chains: ChainGain) -> Gains:
    """Add chains to the file, and return all chains."""
    gains = Gains(gains.models, (*gains.chains, *chains)[-_MOST:])
    save(folder / GAINS, KIND, gains, compact=("chains",))
    return gains
