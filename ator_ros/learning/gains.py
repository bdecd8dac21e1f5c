"""What refined chains gained: measured beside chains that ran as planned, to compare."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import stdtrit

from ator_ros.files import load, save
from ator_ros.geometry import FloatArray
from ator_ros.refinement.gate import MeasuredGain

GAINS, KIND = "gains.json", "gains of refinement"
_MOST = 500
"""Newest chains that count."""
_SHARING = 50
"""Chains up to which the share of comparisons stays what it is; from there on it falls."""


@dataclass(frozen=True)
class ChainGain:
    """One executed chain.

    Attributes
    ----------
    refined : bool
        Whether it was refined; the others ran as planned although they would have been.
    gain : float
        Predicted gain in s.
    excess : float
        Measured less predicted duration in s of the chain as it was executed.
    """

    refined: bool
    gain: float
    excess: float


@dataclass(frozen=True)
class Gains:
    """The chains of one set of models, oldest first; `models` is its digest, empty for those of the start."""

    models: str = ""
    chains: tuple[ChainGain, ...] = ()

    def wants_comparison(self, share: float) -> bool:
        """Return whether the next chain shall run as planned, to compare; `share` is the greatest share."""
        count = len(self.chains) + 1
        compared = sum(not chain.refined for chain in self.chains)
        return compared + 1 <= share * min(count, math.sqrt(_SHARING * count))

    def measured(self) -> MeasuredGain:
        """Return the mean gain of refined chains.

        Predictions of both kinds of chains err, and what comparison shows is the difference. Its interval is
        that of two means (Welch).
        """
        refined = [chain for chain in self.chains if chain.refined]
        compared = _array([chain.excess for chain in self.chains if not chain.refined])
        predicted = float(np.mean([chain.gain for chain in refined])) if refined else math.nan
        gained = _array([chain.gain - chain.excess for chain in refined])
        if min(len(gained), len(compared)) < 2:
            return MeasuredGain(len(gained), len(compared), predicted)
        mean = float(gained.mean() + compared.mean())
        squares = [float(each.var(ddof=1)) / len(each) for each in (gained, compared)]
        total = sum(squares)
        parts = zip(squares, (gained, compared), strict=True)
        freedom = total**2 / max(sum(one**2 / (len(each) - 1) for one, each in parts), 1e-12)
        off = float(stdtrit(max(freedom, 1.0), 0.975)) * math.sqrt(total)
        return MeasuredGain(len(gained), len(compared), predicted, mean, mean - off, mean + off)


def chain_gain(record: Any) -> ChainGain | None:
    """Return what a chain record (ator_interfaces/ChainPerformance) says; None if it says nothing.

    A chain counts if it was refined or ran as planned to compare, if it succeeded, and if nothing happened
    that no prediction contains.
    """
    gain, counts = record.gain, record.refined or record.gain.comparison
    excess = record.actual.duration - record.predicted.duration
    undisturbed = record.outcome.code == record.outcome.SUCCEEDED and not (
        record.fetched or record.refined_again
    )
    if not (counts and undisturbed and math.isfinite(gain.predicted) and math.isfinite(excess)):
        return None
    return ChainGain(not gain.comparison, gain.predicted, excess)


def _array(values: Sequence[float]) -> FloatArray:
    return np.array(values, dtype=float)


def read_gains(folder: Path, models: str) -> Gains:
    """Return the chains executed with a set of models; none if the file is missing or of another set.

    Raises FileError if it is damaged.
    """
    if not (folder / GAINS).exists():
        return Gains(models)
    gains = load(folder / GAINS, KIND, Gains)
    return gains if gains.models == models else Gains(models)


def write_gains(folder: Path, gains: Gains, chain: ChainGain) -> Gains:
    """Add a chain, write the file, and return the chains."""
    gains = Gains(gains.models, (*gains.chains, chain)[-_MOST:])
    save(folder / GAINS, KIND, gains, compact=("chains",))
    return gains
