"""The gate: refine only where it is expected to pay (paper, section 5, "after filtering")."""

from __future__ import annotations

import math
from dataclasses import dataclass

CONTROL_TICK = 0.05
"""Least gain in s that shows in an execution."""
_FEWEST_REFINED, _FEWEST_COMPARED = 10, 3
"""Chains from which on a measured gain counts."""
_DISAPPOINTING = 0.5
"""Share of the predicted gain below which a measured one disappoints."""


@dataclass(frozen=True)
class MeasuredGain:
    """What refined chains have gained, compared with chains that ran as planned.

    Attributes
    ----------
    refined, compared : int
        Numbers of chains.
    predicted : float
        Mean predicted gain in s of the refined ones.
    mean, low, high : float
        Mean gain in s, and its 95 % interval; NaN and infinite until both kinds were executed.
    """

    refined: int = 0
    compared: int = 0
    predicted: float = math.nan
    mean: float = math.nan
    low: float = -math.inf
    high: float = math.inf

    @property
    def disappoints(self) -> bool:
        """Whether the gain is surely less than half of what was predicted."""
        enough = self.refined >= _FEWEST_REFINED and self.compared >= _FEWEST_COMPARED
        return enough and self.high < _DISAPPOINTING * self.predicted

    def __str__(self) -> str:
        """Return it in words."""
        if math.isnan(self.mean):
            return f"not measured yet: {self.refined} chains refined, {self.compared} as planned to compare"
        return (
            f"{self.mean:.2f} s ({self.low:.2f} to {self.high:.2f}) per refined chain, predicted "
            f"{self.predicted:.2f} s: {self.refined} refined, {self.compared} as planned to compare"
        )


@dataclass(frozen=True)
class Gate:
    """Refines where the predicted gain exceeds its own uncertainty.

    The uncertainty comes from the errors of the models on episodes that they were not learned from
    (`ator_ros.performance.errors`), so the gate needs no experiment. The best of many candidates is predicted
    too well. For one variable that is about its uncertainty; of n variables the optimism adds up, while the
    uncertainty of the sum grows with √n only. So the gain must exceed √n uncertainties.

    Attributes
    ----------
    least : float
        Least predicted gain in s.
    factor : float
        Uncertainties that the gain must exceed for one free variable.
    measured : MeasuredGain
        What refined chains have gained; if that disappoints, the gate is closed.
    compare : bool
        Whether a chain that would be refined runs as planned, to compare.
    """

    least: float = CONTROL_TICK
    factor: float = 1.0
    measured: MeasuredGain = MeasuredGain()
    compare: bool = False

    def opens(self, gain: float, uncertainty: float, free: int = 1) -> bool:
        """Return whether a gain in s, predicted for the best of `free` variables, is expected to pay."""
        needed = max(self.least, self.factor * math.sqrt(free) * uncertainty)
        return gain > needed and not self.measured.disappoints

    def decide(self, gain: float, uncertainty: float, free: int = 1) -> tuple[bool, str]:
        """Return whether to refine a chain with a predicted gain in s, and why in words."""
        if not gain >= 0.005:
            return False, "no gain predicted"
        opens = self.opens(gain, uncertainty, free)
        result = "refined" if opens and not self.compare else "kept as planned"
        reason = f"gain {gain:.2f} s ± {uncertainty:.2f} s: {result}"
        if opens and self.compare:
            reason += ", to compare"
        elif gain <= self.least:
            reason += f", as less than {self.least:g} s hardly shows"
        elif self.measured.disappoints:
            reason += f", as refined chains gained less than predicted: {self.measured}"
        return opens and not self.compare, reason


NO_GATE = Gate(0.0, 0.0)
"""Refines wherever a gain is predicted."""
