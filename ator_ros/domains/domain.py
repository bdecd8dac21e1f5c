"""Domains: what they consist of, and how installed ones are found."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import MappingProxyType

import numpy as np

from ator_ros.actions.specification import ActionFactory, ActionSpec
from ator_ros.domains import DEFAULT as DEFAULT
from ator_ros.domains.presentation import Presentation
from ator_ros.performance.features import CANDIDATES, GENERAL, Feature
from ator_ros.printable import printable, quoted
from ator_ros.resources import resource_path
from ator_ros.robot.description import ConfigError, Robot, load_robot
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.objects import objects_in
from ator_ros.tops.ranges import USUAL_RANGES, Ranges
from ator_ros.tops.top import Top
from ator_ros.world.scene import Bay, RoundObject, Scene
from ator_ros.world.sources import ObjectSource
from ator_ros.world.state import World

GROUP = "ator_ros.domains"
"""Entry points of this group name the domains that are installed, ours and those of others."""
DEFAULT_SET = "default"
_LONGEST_REASON = 200
_ENDINGS = (".yaml", ".yml")
NO_OTHERS: Mapping[str, ActionFactory] = MappingProxyType({})

ChainSampler = Callable[[Robot, TopLibrary, np.random.Generator], tuple[World, TopChain]]


def no_bays(_: Scene) -> tuple[Bay, ...]:
    """Return no bays: of a domain in whose scene nothing stands."""
    return ()


class DomainError(ValueError):
    """A domain that cannot be used; the message says what was expected and what came."""


@dataclass(frozen=True)
class Domain:
    """TOPs, the actions that execute them, and the situations in which these are learned and evaluated.

    Attributes
    ----------
    name : str
        Name of the domain.
    tops : tuple of Top
        The TOPs that plans consist of.
    action_sets : mapping of str to tuple of ActionSpec
        Sets of actions by name, each with every action that `tops` name; one is called "default".
    objects : tuple of str
        Names of the objects that conditions speak of; each has a topic of that name.
    chains : mapping of str to callable
        Samplers of situations with a chain to execute in them, by name; evaluations use them.
    variables : mapping of str to callable
        Goal variables that refinement may change where a plan opens them, with their ranges; by default
        place, heading and arrival speed, in the scene's area and within the robot's limits.
    presentation : Presentation
        Words and drawings for reports.
    bodies : mapping of str to RoundObject
        The sizes of `objects`, by name, that robots' descriptions need not describe. What is described in
        neither place is a point, and not simulated.
    bays : callable
        Returns the bays that stand in a scene while this domain is in use; raises ConfigError where the scene
        does not suit. By default none.
    sources : tuple of ObjectSource
        Topics of objects; an object without one has the topic of its name, with Odometry.
    features : tuple of Feature
        The features that the domain adds to the general ones.

    Raises
    ------
    DomainError
        There is no default set of actions, a set lacks an action that a TOP names, a condition or a source
        names an object that `objects` lacks, or an action names a feature that there is not.
    """

    name: str
    tops: tuple[Top, ...]
    action_sets: Mapping[str, tuple[ActionSpec, ...]]
    objects: tuple[str, ...]
    chains: Mapping[str, ChainSampler]
    variables: Ranges = field(default_factory=lambda: USUAL_RANGES)
    presentation: Presentation = field(default_factory=Presentation)
    bodies: Mapping[str, RoundObject] = field(default_factory=dict)
    bays: Callable[[Scene], tuple[Bay, ...]] = no_bays
    sources: tuple[ObjectSource, ...] = ()
    features: tuple[Feature, ...] = ()

    def __post_init__(self) -> None:
        """Check that objects and every set of actions are complete."""
        if DEFAULT_SET not in self.action_sets:
            raise DomainError(
                f"domain {self.name}: expected an action set {DEFAULT_SET!r}, got {sorted(self.action_sets)}"
            )
        strange = sorted(set(self.bodies) - set(self.objects))
        if strange:
            raise DomainError(f"domain {self.name}: bodies: expected some of the objects, got {strange}")
        named = {name for top in self.tops for name in objects_in(top)}
        unknown = sorted((named | {source.name for source in self.sources}) - set(self.objects))
        if unknown:
            raise DomainError(
                f"domain {self.name}: objects: expected all that conditions name, {unknown} are missing"
            )
        for action_set, specs in self.action_sets.items():
            names = {spec.name for spec in specs}
            missing = sorted({top.action for top in self.tops} - names)
            if missing:
                raise DomainError(
                    f"domain {self.name}: action set {action_set!r}: expected the actions {missing} of its "
                    f"TOPs, it has {sorted(names)}"
                )
        self._check_features()

    def _check_features(self) -> None:
        names = [*GENERAL, *(feature.name for feature in self.features)]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise DomainError(f"domain {self.name}: features: expected each name once, {twice} are repeated")
        for action_set, specs in self.action_sets.items():
            for spec in specs:
                if unknown := [name for name in spec.features if name not in names]:
                    raise DomainError(
                        f"domain {self.name}: action set {action_set!r}: {spec.name}: features: "
                        f"expected some of {names}, got {unknown}"
                    )

    @cached_property
    def known_features(self) -> Mapping[str, Feature]:
        """The general features and the domain's own, by name: those that its model files may name."""
        return {**GENERAL, **{feature.name: feature for feature in self.features}}

    @property
    def shipped_models(self) -> Path:
        """The folder of the models that are used where no other is named: a domain never uses another's."""
        models = resource_path("models")
        return models if self.name == DEFAULT else models / self.name

    def robot(self, path: Path | str | None = None) -> Robot:
        """Read a robot's description, the shipped one by default; return it in this domain's scene.

        Raises
        ------
        ConfigError
            The file cannot be used, or its scene does not suit the domain.
        """
        robot = load_robot(path)
        try:
            return self.equip(robot)
        except ConfigError as error:
            raise ConfigError(f"{path or 'the shipped robot'}: domain {self.name}: {error}") from error

    def equip(self, robot: Robot) -> Robot:
        """Return `robot` in this domain's scene.

        Its area is that of the description. In it are the domain's objects, as the description has them, or
        else as the domain has them, and the domain's bays.
        """
        known = {**self.bodies, **robot.scene.objects}
        objects = {name: known[name] for name in self.objects if name in known}
        scene = dataclasses.replace(robot.scene, objects=objects, bays=self.bays(robot.scene))
        return dataclasses.replace(robot, scene=scene)

    def actions(self, action_set: str = DEFAULT_SET) -> dict[str, ActionSpec]:
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

    def candidates(self, action: str, action_set: str = DEFAULT_SET) -> tuple[Feature, ...]:
        """Return the candidate features of an action; the general ones where the domain names none."""
        chosen = {spec.name: spec.features for spec in self.action_sets.get(action_set, ())}
        return tuple(self.known_features[name] for name in chosen.get(action, ())) or CANDIDATES

    def source(self, name: str) -> ObjectSource:
        """Return where the state of an object comes from."""
        given = (source for source in self.sources if source.name == name)
        return next(given, ObjectSource(name, optional=True))

    def library(
        self, robot: Robot, action_set: str = DEFAULT_SET, factories: Mapping[str, ActionFactory] = NO_OTHERS
    ) -> TopLibrary:
        """Return the TOPs of the domain with the actions of one set.

        Parameters
        ----------
        robot : Robot
            The robot that executes.
        action_set : str
            Name of the set.
        factories : mapping of str to callable
            Makers that take the place of the specifications', by the names of the actions.

        Raises
        ------
        DomainError
            There is no such set.
        """
        made = {name: spec.factory for name, spec in self.actions(action_set).items()}
        made |= {name: factory for name, factory in factories.items() if name in made}
        return TopLibrary(robot, action_set, tops=self.tops, actions=made, ranges=self.variables)


def installed_domains() -> dict[str, EntryPoint]:
    """Return the entry points of the domains that are installed, by name."""
    return {entry.name: entry for entry in entry_points(group=GROUP)}


def find_domain(name: str = DEFAULT) -> Domain:
    """Return an installed domain by its name, or one that a YAML file declares by the path of the file.

    Raises
    ------
    DomainError
        No entry point of the group `ator_ros.domains` has this name, it cannot be imported, or it is not a
        `Domain`; or the file cannot be used.
    """
    if "/" in name or name.endswith(_ENDINGS):
        from ator_ros.domains.domain_file import read_domain  # which needs `Domain`

        return read_domain(Path(name))
    found = installed_domains()
    if name not in found:
        raise DomainError(
            f"domain: expected an entry point of {GROUP}, one of {sorted(found)}, got {quoted(name)}"
        )
    try:
        domain = found[name].load()
    except Exception as error:  # a module from outside raises anything
        raise DomainError(
            f"domain {name}: expected to import {found[name].value}, got {type(error).__name__}: "
            f"{printable(str(error), _LONGEST_REASON)}"
        ) from error
    if not isinstance(domain, Domain):
        raise DomainError(
            f"domain {name}: expected {found[name].value} to be a Domain, got {type(domain).__name__}"
        )
    return domain
