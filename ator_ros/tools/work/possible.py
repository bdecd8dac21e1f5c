"""What of a domain a robot can execute."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ator_ros.domains.domain import Domain
from ator_ros.evaluation.trials import random_trial
from ator_ros.robot.description import ConfigError, Robot
from ator_ros.tops.library import TopLibrary


def possible_actions(domain: Domain, action_set: str, robot: Robot) -> tuple[list[str], dict[str, str]]:
    """Return the actions that a robot can execute, and why it can't the others."""
    actions, left_out = [], {}
    for name, spec in domain.actions(action_set).items():
        try:
            spec.factory(robot)
            spec.sample(robot, np.random.default_rng(0))
        except ConfigError as error:
            left_out[name] = str(error)
        else:
            actions.append(name)
    library = domain.library(robot, action_set)
    lacking = {top.action: library.left_out.get(top.name) for top in domain.tops}
    return actions, left_out | {name: reason for name, reason in lacking.items() if reason is not None}


def possible_chain(
    domain: Domain, library: TopLibrary, wanted: str | None, actions: Sequence[str]
) -> str | None:
    """Return the chain that was asked for, or else the first one all of whose actions are among `actions`."""
    for name in sorted(domain.chains, key=lambda name: name != wanted):
        try:
            trial = random_trial(domain, name, library, seed=0, index=0)
        except ConfigError:
            continue
        if all(call.top.action in actions for call in trial.chain.calls):
            return name
    return None
