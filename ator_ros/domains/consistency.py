"""What a domain's parts must agree on, checked when it is made."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ator_ros.actions import DEFAULT_SET
from ator_ros.actions.goal_variables import (
    GOAL_VARIABLES,
    MOST_GOAL_VARIABLES,
    GoalVariable,
    direct_name,
)
from ator_ros.actions.specification import ActionSpec
from ator_ros.performance.direct import DIRECT_VARIABLES
from ator_ros.performance.features import GENERAL
from ator_ros.tops.objects import objects_in

if TYPE_CHECKING:
    from ator_ros.domains.domain import Domain


def inconsistencies(domain: Domain) -> Iterator[str]:
    """Yield what contradicts, one sentence each; nothing where all parts agree."""
    if DEFAULT_SET not in domain.action_sets:
        yield f"expected an action set {DEFAULT_SET!r}, got {sorted(domain.action_sets)}"
    yield from _of_objects(domain)
    declared: dict[str, GoalVariable] = {}
    features = [*GENERAL, *(feature.name for feature in domain.features)]
    yield from _of_features(domain, features)
    for action_set, specs in domain.action_sets.items():
        where = f"action set {action_set!r}"
        for spec in specs:
            own = [direct_name(variable.name) for variable in spec.goal_variables]
            if unknown := [name for name in spec.features if name not in (*features, *own)]:
                yield f"{where}: {spec.name}: features: expected some of {features}, got {unknown}"
            for problem in (*_of_goal(domain, spec), *_of_declarations(spec, declared)):
                yield f"{where}: {spec.name}: goal_variables: {problem}"


def _of_objects(domain: Domain) -> Iterator[str]:
    if strange := sorted(set(domain.bodies) - set(domain.objects)):
        yield f"bodies: expected some of the objects, got {strange}"
    named = {name for top in domain.tops for name in objects_in(top)}
    unknown = sorted((named | {source.name for source in domain.sources}) - set(domain.objects))
    if unknown:
        yield f"objects: expected all that conditions name, {unknown} are missing"


def _of_features(domain: Domain, names: list[str]) -> Iterator[str]:
    """Yield problems with feature names: duplicates, and features derived from unknown variables."""
    variables = [direct_name(name) for name in domain.goal_variables]
    everything = [*names, *variables]
    if twice := sorted({name for name in everything if everything.count(name) > 1}):
        yield f"features: expected each name once, {twice} are repeated"
    for feature in domain.features:
        if unknown := sorted(feature.derives - {*DIRECT_VARIABLES, *variables}):
            yield f"features: {feature.name}: expected to derive from direct variables, got {unknown}"


def _of_goal(domain: Domain, spec: ActionSpec) -> Iterator[str]:
    """Yield which goal variables conditions or its server's goal name, and the action does not have."""
    known = {*GOAL_VARIABLES, *(variable.name for variable in spec.goal_variables)}
    fillings = () if spec.remote is None else spec.remote.goal
    names = {filling.goal_variable for filling in fillings} - {None}
    if unknown := sorted(str(name) for name in names - known):
        yield f"expected all that its server's goal is filled from, {unknown} are missing"
    for top in domain.tops:
        unknown = sorted((top.pre.goal_names() | top.post.goal_names()) - known)
        if top.action == spec.name and unknown:
            yield f"expected all that the conditions of {top.name} name, {unknown} are missing"


def _of_declarations(spec: ActionSpec, declared: dict[str, GoalVariable]) -> Iterator[str]:
    """Yield declarations that contradict earlier ones; earlier ones are in `declared`."""
    names = [variable.name for variable in spec.goal_variables]
    if len(names) > MOST_GOAL_VARIABLES or len(set(names)) != len(names):
        yield f"expected at most {MOST_GOAL_VARIABLES}, each name once, got {names}"
    for variable in spec.goal_variables:
        if declared.setdefault(variable.name, variable) != variable:
            yield f"expected the same {variable.name} in all actions, got {variable}"
