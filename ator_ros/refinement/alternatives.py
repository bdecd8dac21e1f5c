"""Several chains for the same end: each is refined, and the one predicted best is chosen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ator_ros.refinement.answer import Refinement
from ator_ros.refinement.chain_model import ChainPrediction
from ator_ros.refinement.errors import RefinementError
from ator_ros.refinement.objective import Objective
from ator_ros.refinement.refiner import Refiner
from ator_ros.refinement.slices import Slices
from ator_ros.tops.chain import TopChain
from ator_ros.world.state import World

MOST_ALTERNATIVES = 7
"""Other chains that a request may have."""


@dataclass(frozen=True, slots=True)
class Judged:
    """One of several chains: what became of its refinement, or why it was skipped."""

    reason: str
    refinement: Refinement | None = None

    @property
    def prediction(self) -> ChainPrediction | None:
        """The prediction of the chain to execute; None where it was skipped."""
        found = self.refinement
        if found is None:
            return None
        return found.after if found.refined else found.before

    @property
    def rank(self) -> tuple[float, float]:
        """Sort key: the cost; chains of which something is not predicted come after the others."""
        found, prediction = self.refinement, self.prediction
        if found is None or prediction is None:
            return math.inf, math.inf
        return float(len(found.without_model)), prediction.cost


@dataclass(frozen=True, slots=True)
class Selection:
    """The chains of a request in their order, and the number, from 0, of the best."""

    judged: tuple[Judged, ...]
    number: int

    @property
    def refinement(self) -> Refinement:
        """The refinement of the chosen chain."""
        found = self.judged[self.number].refinement
        assert found is not None
        return found

    def with_chosen(self, refinement: Refinement) -> Selection:
        """Return the selection with another refinement of the chosen chain."""
        chosen = Judged(refinement.reason, refinement)
        before, after = self.judged[: self.number], self.judged[self.number + 1 :]
        return Selection((*before, chosen, *after), self.number)


def choosing(
    refiner: Refiner,
    world: World,
    chains: Sequence[TopChain | str],
    objective: Objective | None = None,
    *,
    placeholders: bool = False,
) -> Slices[Selection]:
    """Refine each of `chains` and choose the best, in slices; when time is up, the rest is only predicted.

    Parameters
    ----------
    refiner, world, objective, placeholders
        As for `Refiner.refining`.
    chains : sequence of TopChain or str
        The chains, or why one cannot be used. One that is no valid plan from `world` is skipped.

    Raises
    ------
    RefinementError
        None of them can be used; the message says why, for each.
    """
    judged: list[Judged] = []
    for chain in chains:
        each = yield from _judged(refiner, world, chain, objective, placeholders=placeholders)
        judged.append(each)
    number = min(range(len(judged)), key=lambda index: judged[index].rank)
    if judged[number].refinement is None:
        raise RefinementError(_told([each.reason for each in judged]))
    return Selection(tuple(judged), number)


def _judged(
    refiner: Refiner,
    world: World,
    chain: TopChain | str,
    objective: Objective | None,
    *,
    placeholders: bool,
) -> Slices[Judged]:
    if isinstance(chain, str):
        return Judged(chain)
    yield
    violations = chain.violations(world, refiner.robot)
    if violations:
        return Judged(f"no valid plan: {'; '.join(violations)}")
    yield
    try:
        found = yield from refiner.refining(world, chain, objective, placeholders=placeholders)
    except RefinementError as error:
        return Judged(str(error))
    return Judged(found.reason, found)


def _told(reasons: Sequence[str]) -> str:
    """Return why no chain can be used; the first is that of the request, the others its alternatives."""
    first, *others = reasons
    return "; ".join([first, *(f"alternative {number}: {said}" for number, said in enumerate(others, 1))])
