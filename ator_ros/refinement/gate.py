"""The gate: refine only where it is expected to pay (paper, section 5, "after filtering")."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ator_ros.refinement.chain_prediction import GainError
from ator_ros.world.state import CONTROL_PERIOD

# chains from which on a measured gain can close the gate: with fewer its interval is too wide
_FEWEST_REFINED = 10
_FEWEST_COMPARED = 3
_REQUIRED = 0.5  # share of the predicted gain that the measured one has to reach
KEPT_NAIVE = "kept naive"
KEPT_AS_SENT = "kept as sent"
"""What happens to a chain that is not refined: its reference is the naive one, or the one sent."""
_ZERO = 0.005  # gain in s that is shown as 0.00 s
_ZERO_SHARE = 0.0005  # gain as a share of the cost that is shown as 0.0 %


@dataclass(frozen=True)
class MeasuredGain:
    """The gain of refined chains, compared with chains that ran naive.

    Attributes
    ----------
    refined, compared : int
        Numbers of chains.
    predicted : float
        Mean predicted gain in duration of the refined ones, in s; it may be negative with other
        objectives.
    mean, low, high : float
        Mean gain in s, and its 95 % interval; NaN until two chains of each kind were executed.
    """

    refined: int = 0
    compared: int = 0
    predicted: float = math.nan
    mean: float = math.nan
    low: float = math.nan
    high: float = math.nan

    @property
    def too_low(self) -> bool:
        """Whether the interval lies below half of the predicted gain."""
        enough = self.refined >= _FEWEST_REFINED and self.compared >= _FEWEST_COMPARED
        return enough and self.predicted > 0.0 and self.high < _REQUIRED * self.predicted

    def __str__(self) -> str:
        """Return it in words."""
        if math.isnan(self.mean):
            return (
                f"unknown: {self.refined} refined chains and {self.compared} naive ones; "
                "two of each needed"
            )
        return (
            f"{self.mean:.2f} s ({self.low:.2f} to {self.high:.2f}), "
            f"predicted {self.predicted:.2f} s, "
            f"from {self.refined} refined chains and {self.compared} naive ones"
            f"{'; too low: the gate is closed' if self.too_low else ''}"
        )


@dataclass(frozen=True)
class Gate:
    """Refines where the expected gain exceeds its own uncertainty.

    The uncertainty comes from the errors of the models on episodes that they were not learned from
    (`ator_ros.performance.error_process`), so the gate needs no experiment.

    Attributes
    ----------
    least : float
        Least predicted gain in s: less hardly shows in an execution.
    factor : float
        Uncertainties that the gain must exceed.
    least_share : float
        Least predicted gain as a share of the cost, where durations do not dominate it: of a chain
        of 5 s it is one control tick.
    measured : MeasuredGain
        The gain of refined chains; if it is too low, the gate is closed.
    drawn : bool
        Whether this chain was drawn for the opposite decision, to measure the gain: naive although
        it would be refined, or refined although the gate is closed.
    """

    least: float = CONTROL_PERIOD
    factor: float = 1.0
    least_share: float = 0.01
    measured: MeasuredGain = MeasuredGain()
    drawn: bool = False

    def judged(self, gain: float, error: GainError) -> float:
        """Return the gain to judge, in s, for a predicted gain: without a gate that is the same.

        Otherwise it includes the expected error: the gain is then as likely to be less as more.
        """
        return gain + error.expected if self.factor else gain

    def pays(self, gain: float, uncertainty: float | None) -> bool:
        """Return whether a predicted gain is expected to pay; the arguments are as in `decide`."""
        if uncertainty is None:
            return gain > self.least_share
        return gain > self.least and (self.factor == 0.0 or gain > self.factor * uncertainty)

    def decide(
        self,
        gain: float,
        uncertainty: float | None,
        kept: str = KEPT_NAIVE,
    ) -> tuple[bool, str]:
        """Return whether to refine a chain with a predicted gain, and why in words.

        Parameters
        ----------
        gain : float
            In s, or as a share of the cost where durations do not dominate it.
        uncertainty : float or None
            Of the gain, in s; None where durations do not dominate the cost, as only errors of
            predicted durations are known.
        kept : str
            What happens to the chain if it is not refined: `KEPT_NAIVE` or `KEPT_AS_SENT`.
        """
        if not gain >= (_ZERO_SHARE if uncertainty is None else _ZERO):
            return False, "no gain predicted"
        pays = self.pays(gain, uncertainty)
        refine = pays and self.drawn == self.measured.too_low
        if uncertainty is None:
            amount = f"gain {100.0 * gain:.1f} % of the cost, of unknown uncertainty"
            is_certain = True
            least = f"{100.0 * self.least_share:g} %"
        else:
            amount = f"gain {gain:.2f} s ± {uncertainty:.2f} s"
            is_certain = gain > self.factor * uncertainty
            least = f"one control tick ({self.least:g} s)"
        reason = f"{amount}: {'refined' if refine else kept}"
        if pays and self.drawn:
            reason += ", to measure what refinement gains"
        elif pays and self.measured.too_low:
            reason += f", as the measured gain is {self.measured}"
        elif is_certain and not pays:
            reason += f", as it is not above {least}"
        return refine, reason


NO_GATE = Gate(0.0, 0.0, 0.0)
"""Refines wherever a gain is predicted."""
