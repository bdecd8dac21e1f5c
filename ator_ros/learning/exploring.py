"""Trying what is not the best by prediction, within a share of the predicted time: so that it gets known."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from ator_ros.actions.goal_variables import with_values
from ator_ros.refinement.chain_prediction import ChainPrediction
from ator_ros.refinement.refiner import Refinement
from ator_ros.tops.chain import TopChain

SURE = 0.9
"""Least predicted probability with which every action of a chain that is tried succeeds."""
_TRIED = 6  # candidates that are predicted; of these the one with the largest spread is the least known


class Explorer:
    """Replaces the best chain by one that is less known, now and then.

    Parameters
    ----------
    share : float
        Greatest share of the predicted time of all chains so far that what was tried may have cost.
    seed : int
        Of its choices.

    Attributes
    ----------
    share : float
        As given; it may change.
    """

    def __init__(self, share: float, seed: int = 0) -> None:
        self.share = share
        self._rng = np.random.default_rng(seed)
        self.played = self.spent = 0.0
        """Predicted time in s of all chains, and what was added to it to try others."""
        self.tried = 0

    def explored(self, found: Refinement, predict: Callable[[TopChain], ChainPrediction]) -> Refinement:
        """Return the answer, or one with a chain to try, whose reason says so.

        Parameters
        ----------
        found : Refinement
            What refinement answers.
        predict : callable
            Predicts a chain from the same state.
        """
        usual = found.after if found.refined else found.before
        if not np.isfinite(usual.duration):
            return found
        self.played += usual.duration
        allowed = self.share * self.played - self.spent
        if not found.curves or allowed <= 0.0:
            return found
        best: tuple[float, float, TopChain] | None = None
        for chain in self._candidates(found, allowed):
            predicted = predict(chain)
            extra = predicted.duration - usual.duration
            known = best is not None and predicted.spread <= best[0]
            if not known and extra <= allowed and _sure(predicted):
                best = predicted.spread, extra, chain
        if best is None:
            return found
        _, extra, chain = best
        self.spent += max(extra, 0.0)
        self.tried += 1
        reason = f"exploring: predicted to take {extra:+.2f} s; {found.reason}"
        return dataclasses.replace(found, chain=chain, refined=True, reason=reason)

    def _candidates(self, found: Refinement, allowed: float) -> list[TopChain]:
        """Draw chains that differ from the best at one subgoal, and should not cost more than allowed."""
        curve = found.curves[int(self._rng.integers(len(found.curves)))]
        least = float(np.min(curve.totals))
        rows = self._rng.permutation(np.flatnonzero(curve.totals - least <= allowed))[:_TRIED]
        chains = []
        for row in rows:
            values = dict(zip(curve.names, map(float, curve.values[row]), strict=True))
            goal = with_values(found.best.calls[curve.subgoal].goal, values)
            chains.append(found.best.with_goal(curve.subgoal, goal))
        return chains

    def told(self) -> dict[str, object]:
        """Return what diagnostics tell; nothing where nothing is ever tried."""
        if self.share <= 0.0:
            return {}
        percent = 100.0 * self.spent / self.played if self.played else 0.0
        return {
            "chains that explore": self.tried,
            "predicted time spent exploring (%)": f"{percent:.2f}",
        }


def _sure(predicted: ChainPrediction) -> bool:
    return all(action.get("success", 0.0) >= SURE for action in predicted.actions)
