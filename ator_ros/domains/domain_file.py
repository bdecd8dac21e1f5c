"""A domain as a YAML file: objects, TOPs and goal variables as data, actions of others by name."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from ator_ros.actions import DEFAULT_SET
from ator_ros.actions.base import Point
from ator_ros.actions.remote import UnreachableAction
from ator_ros.actions.situation import Situation
from ator_ros.actions.specification import ActionSpec
from ator_ros.domains.declared import DeclaredAction, DeclaredDomain
from ator_ros.domains.declared_situations import ChainsOf, DrivesOf
from ator_ros.domains.domain import Domain, DomainError, find_domain, installed_domains, no_bays
from ator_ros.domains.programs import NoStandInError, Program, stand_in
from ator_ros.files import FileError, content_if_stated, read_yaml
from ator_ros.performance.features import Feature, names_of
from ator_ros.performance.training import OBSERVED
from ator_ros.robot.description import Robot
from ator_ros.schema import SchemaError, structured
from ator_ros.tops.ranges import USUAL_RANGES
from ator_ros.world.scene import Bay, Scene

_LARGEST = 200_000
"""Bytes of a file; one with a dozen TOPs has 5 kB."""


def read_domain(path: Path) -> Domain:
    """Read a domain from a YAML file (docs/remote_actions.md describes it).

    Raises
    ------
    DomainError
        The file cannot be used; the message names file, field, what was expected and what came.
    """
    domain = declared_domain(path)
    if domain.name in installed_domains():
        raise DomainError(
            f"{path}: name: expected none of the installed domains, whose models have that name, "
            f"got {domain.name!r}"
        )
    return domain


def declared_domain(path: Path) -> Domain:
    """Read a domain as `read_domain` does, under whatever name: for a package that installs its file."""
    try:
        data = content_if_stated(read_yaml(path, largest=_LARGEST), "domain")
        declared = structured(data, DeclaredDomain, closed=True)
    except FileError as error:
        raise DomainError(str(error)) from error
    except SchemaError as error:
        raise DomainError(f"{path}: {error}") from error
    variables = declared.variables
    points = {top.action: Point(top.point) for top in reversed(declared.tops)}
    actions = [
        _spec(action, points.get(action.name, Point.AXLE), declared.time_limit, f"{path}: actions[{number}]")
        for number, action in enumerate(declared.actions)
    ]
    return Domain(
        declared.name,
        tops=tuple(top.made() for top in declared.tops),
        action_sets={DEFAULT_SET: tuple(spec for spec, _ in actions)},
        objects=tuple(item.name for item in declared.objects),
        chains={chain.name: ChainsOf(chain, declared.time_limit) for chain in declared.chains},
        sources=declared.objects,
        variables=USUAL_RANGES if variables is None else {item.name: item.range for item in variables},
        features=tuple(dict.fromkeys(feature for _, features in actions for feature in features)),
        bays=_those_described if declared.bays else no_bays,
        description=None if declared.robot is None else path.parent / declared.robot,
        programs=tuple(_beside(path, program) for program in declared.servers),
        time_limit=declared.time_limit,
    )


def _beside(path: Path, program: Program) -> Program:
    """Return a program whose command runs in its folder relative to the file, which may be a link."""
    if not program.command:
        return program
    return dataclasses.replace(program, folder=str((path.resolve().parent / program.folder).resolve()))


def _those_described(scene: Scene) -> tuple[Bay, ...]:
    return scene.bays


def _spec(
    action: DeclaredAction, point: Point, time_limit: float, where: str
) -> tuple[ActionSpec, tuple[Feature, ...]]:
    """Return the specification of an action, and the features that its own domain adds for it."""
    if action.local is None:
        return _remote_spec(action, point, time_limit, where), ()
    try:
        domain = find_domain(action.local.domain)
        found = domain.actions(action.local.action_set)
    except DomainError as error:
        raise DomainError(f"{where}.local: {error}") from error
    if action.name not in found:
        raise DomainError(f"{where}.name: expected one of {', '.join(found)}, got {action.name!r}")
    spec = found[action.name]
    return spec, tuple(feature for feature in domain.features if feature.name in spec.features)


def _remote_spec(action: DeclaredAction, point: Point, time_limit: float, where: str) -> ActionSpec:
    try:
        factory = UnreachableAction if action.stand_in is None else stand_in(action.stand_in)
    except NoStandInError as error:
        raise DomainError(f"{where}.stand_in: {error}") from error
    sample = (
        _never_driven
        if action.drives is None
        else DrivesOf(action.name, action.drives, point, action.goal_variables, time_limit)
    )
    return ActionSpec(
        action.name,
        factory,
        sample,
        names_of(OBSERVED),
        remote=action.remote,
        goal_variables=action.goal_variables,
    )


def _never_driven(_robot: Robot, _rng: np.random.Generator) -> Situation:
    raise DomainError(
        "an action on a server is observed where the executor runs it: expected `drives` in the domain's "
        "file to collect it, got none"
    )
