"""The gate: refine only where it is expected to pay (paper, section 5, "after filtering")."""

from __future__ import annotations

from dataclasses import dataclass

CONTROL_TICK = 0.05
"""Least gain in s that shows in an execution."""


@dataclass(frozen=True)
class Gate:
    """Refines where the predicted gain exceeds its own uncertainty.

    The uncertainty comes from the errors of the models on episodes that they were not learned from
    (`ator_ros.performance.errors`), so the gate needs no experiment. The best of many candidates is predicted
    too well, by about one uncertainty: more is asked for.

    Attributes
    ----------
    least : float
        Least predicted gain in s.
    factor : float
        Uncertainties that the gain must exceed.
    """

    least: float = CONTROL_TICK
    factor: float = 1.0

    def decide(self, gain: float, uncertainty: float) -> tuple[bool, str]:
        """Return whether a predicted gain in s, with its uncertainty in s, pays, and why in words."""
        if not gain >= 0.005:
            return False, "no gain predicted"
        pays = gain > max(self.least, self.factor * uncertainty)
        return pays, f"gain {gain:.2f} s ± {uncertainty:.2f} s: {'refined' if pays else 'kept as planned'}"


NO_GATE = Gate(0.0, 0.0)
"""Refines wherever a gain is predicted."""
