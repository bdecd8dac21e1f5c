"""Situations of a domain with their plans, as drafts."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping

from ator_ros.domains.domain import Domain
from ator_ros.evaluation.trials import open_speeds, random_trial
from ator_ros.refinement.objective import expected_time
from ator_ros.tops.library import LeftOutError, TopLibrary
from ator_ros.viewing.draft import Draft


def drawn(
    domain: Domain,
    libraries: Mapping[str, TopLibrary],
    chain: str,
    *,
    seed: int,
    index: int,
    like: Draft | None = None,
) -> Draft:
    """Return the draft of a random situation of a chain of the domain.

    Parameters
    ----------
    domain, libraries : Domain, mapping of str to TopLibrary
        What is played, and the actions by set.
    chain : str
        Name of the chain.
    seed, index : int
        Which situation.
    like : Draft, optional
        Whose action set and objective it has; by default the first set, and the expected time.
    """
    library = next(iter(libraries.values())) if like is None else libraries[like.action_set]
    trial = random_trial(domain, chain, library, seed=seed, index=index)
    objective = expected_time(domain.time_limit) if like is None else like.objective
    return Draft(trial.world, open_speeds(trial.chain), library.action_set, objective)


def first(domain: Domain, libraries: Mapping[str, TopLibrary]) -> tuple[str, Draft]:
    """Return the first chain for whose steps there are actions, and its first situation."""
    *others, last = domain.chains
    for name in others:
        with contextlib.suppress(LeftOutError):
            return name, drawn(domain, libraries, name, seed=0, index=0)
    return last, drawn(domain, libraries, last, seed=0, index=0)
