"""What a domain consists of, and where domains are found."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import cast

import numpy as np

from ator_ros.actions.specification import ActionSpec
from ator_ros.performance.training import CANDIDATES
from ator_ros.printable import printable, quoted
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.top import Top
from ator_ros.world.state import World

GROUP = "ator_ros.domains"
"""Entry points of this group name the domains that are installed, ours and those of others."""
DEFAULT = "soccer"
_ACTION_SET = "default"
_LONGEST_REASON = 200

ChainSampler = Callable[[Robot, TopLibrary, np.random.Generator], tuple[World, TopChain]]


class DomainError(ValueError):
    """A domain that cannot be used; the message says what was expected and what came."""


@dataclass(frozen=True)
class Domain:
    """TOPs, the actions that execute them, and the situations that they are learned and measured in.

    Attributes
    ----------
    name : str
        Name of the domain.
    tops : tuple of Top
        The TOPs that plans consist of.
    action_sets : mapping of str to tuple of ActionSpec
        Sets of actions by name, each with every action that `tops` name; one is called "default".
    chains : mapping of str to callable
        Samplers of situations with a chain to execute in them, by name; evaluations use them.
    """

    name: str
    tops: tuple[Top, ...]
    action_sets: Mapping[str, tuple[ActionSpec, ...]]
    chains: Mapping[str, ChainSampler]

    def actions(self, action_set: str = "default") -> dict[str, ActionSpec]:
        """Return the specifications of a set by the names of the actions.

        Raises
        ------
        DomainError
            There is no such set.
        """
        if action_set not in self.action_sets:
            raise DomainError(
                f"action set of {self.name}: expected one of {sorted(self.action_sets)}, got {action_set!r}"
            )
        return {spec.name: spec for spec in self.action_sets[action_set]}

    def candidates(self, action: str, action_set: str = "default") -> tuple[str, ...]:
        """Return the candidate features of an action; all general ones where the domain names none."""
        chosen = {spec.name: spec.features for spec in self.action_sets.get(action_set, ())}
        return chosen.get(action) or CANDIDATES

    def library(self, robot: Robot, action_set: str = "default") -> TopLibrary:
        """Return the TOPs of the domain with the actions of one set.

        Raises
        ------
        DomainError
            There is no such set.
        KeyError
            A TOP names an action that the set lacks.
        """
        factories = {name: spec.factory for name, spec in self.actions(action_set).items()}
        return TopLibrary(robot, action_set, tops=self.tops, actions=factories)


def find_domain(name: str = DEFAULT) -> Domain:
    """Return an installed domain.

    Raises
    ------
    DomainError
        No entry point of the group `ator_ros.domains` has this name, it cannot be loaded, or it is not a
        `Domain` whose action sets have all actions that its TOPs name.
    """
    found = {entry.name: entry for entry in entry_points(group=GROUP)}
    if name not in found:
        raise DomainError(f"domain: expected one of {sorted(found)}, got {quoted(name)}")
    try:
        domain = found[name].load()
        problem = _problem(domain)
    except Exception as error:  # code of others, which may raise anything
        problem = f"it raised {type(error).__name__}: {printable(str(error), _LONGEST_REASON)}"
        raise DomainError(f"domain {name}: {found[name].value} cannot be used: {problem}") from error
    if problem:
        raise DomainError(f"domain {name}: expected {found[name].value} to be {problem}")
    return cast("Domain", domain)


def _problem(domain: object) -> str:
    """Return what a domain was expected to be, and what it is; empty where nothing is wrong with it."""
    if not isinstance(domain, Domain):
        return f"a Domain, got {type(domain).__name__}"
    if _ACTION_SET not in domain.action_sets:
        return f"a Domain with the action set {_ACTION_SET!r}, got {sorted(domain.action_sets)}"
    named = {top.action for top in domain.tops}
    for action_set in domain.action_sets:
        known = set(domain.actions(action_set))
        if named - known:
            return f"a Domain whose set {action_set!r} has the actions {sorted(named)}, got {sorted(known)}"
    return ""
