"""Domains: what they consist of, and how installed ones are found."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import MappingProxyType

import numpy as np

from ator_ros.actions import DEFAULT_SET, TIME_LIMIT
from ator_ros.actions.goal_variables import GoalVariable, direct_name
from ator_ros.actions.remote import RemoteCall
from ator_ros.actions.specification import ActionFactory, ActionSpec
from ator_ros.domains import DEFAULT, DRIVE
from ator_ros.domains.consistency import inconsistencies
from ator_ros.domains.measurements import Measurements
from ator_ros.domains.presentation import Presentation
from ator_ros.domains.programs import Program
from ator_ros.performance.features import CANDIDATES, GENERAL, Feature, goal_feature
from ator_ros.printable import printable, quoted
from ator_ros.resources import resource_path
from ator_ros.robot.description import ConfigError, Robot, load_robot
from ator_ros.tops.chain import TopChain
from ator_ros.tops.conditions import Condition
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.ranges import USUAL_RANGES, Ranges, declared_ranges
from ator_ros.tops.top import Top
from ator_ros.world.messages import ObjectSource
from ator_ros.world.scene import Bay, RoundObject, Scene
from ator_ros.world.state import World

GROUP = "ator_ros.domains"
"""Entry points of this group name the domains that are installed, ours and those of others."""
_LONGEST_REASON = 200
_ENDINGS = (".yaml", ".yml")
NO_OTHERS: Mapping[str, ActionFactory] = MappingProxyType({})

ChainSampler = Callable[[Robot, TopLibrary, np.random.Generator], tuple[World, TopChain]]


def no_goals(_: Robot) -> Mapping[str, Condition]:
    """Return no goals: of a domain that names none."""
    return {}


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
        The TOPs that plans consist of, with the tolerances for a usual robot; see `tops_for`.
    action_sets : mapping of str to tuple of ActionSpec
        Sets of actions by name; one is called "default". TOPs whose action a set lacks are left out with it.
    objects : tuple of str
        Names of the objects that conditions speak of, by default none; each has a topic of that name.
    chains : mapping of str to callable
        Samplers of situations with a chain to execute in them, by name; evaluations and gates need one.
    variables : mapping of str to callable
        Goal variables that refinement may change where a plan opens them, with their ranges; by default
        place, heading and arrival speed, in the scene's area and within the robot's limits. What an action
        declares besides (`ActionSpec.goal_variables`) brings its own range.
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
    description : Path or None
        Of the robot and its scene, used where no other is named; None: the one that is shipped.
    programs : tuple of Program
        Programs of others that its actions need; tools that start our nodes start them too.
    time_limit : float
        Time in s that an action or a chain may take in a simulation without ROS.
    goals : callable
        Returns, for a robot in its scene, the goals that plans may be asked for by name: conditions whose
        targets are numbers or state variables. By default none.
    measurements : Measurements
        What only the domain can measure of its actions, for the tools that do so; by default nothing.
    fitted : callable, optional
        Returns the same TOPs with the tolerances and regions of a robot and its scene; by default `tops`.

    Raises
    ------
    DomainError
        There is no default set of actions, a condition or a source names an object that `objects` lacks, a
        condition names a goal variable that the TOP's action lacks, an action names a feature that there is
        not, or two actions declare one goal variable differently.
    """

    name: str
    tops: tuple[Top, ...]
    action_sets: Mapping[str, tuple[ActionSpec, ...]]
    objects: tuple[str, ...] = ()
    chains: Mapping[str, ChainSampler] = field(default_factory=dict)
    variables: Ranges = field(default_factory=lambda: USUAL_RANGES)
    presentation: Presentation = field(default_factory=Presentation)
    bodies: Mapping[str, RoundObject] = field(default_factory=dict)
    bays: Callable[[Scene], tuple[Bay, ...]] = no_bays
    sources: tuple[ObjectSource, ...] = ()
    features: tuple[Feature, ...] = ()
    description: Path | None = None
    programs: tuple[Program, ...] = ()
    time_limit: float = TIME_LIMIT
    goals: Callable[[Robot], Mapping[str, Condition]] = no_goals
    measurements: Measurements = field(default_factory=Measurements)
    fitted: Callable[[Robot], tuple[Top, ...]] | None = None

    def __post_init__(self) -> None:
        """Check that its parts agree."""
        for problem in inconsistencies(self):
            raise DomainError(f"domain {self.name}: {problem}")

    @cached_property
    def goal_variables(self) -> Mapping[str, GoalVariable]:
        """The goal variables that actions declare, by name: each means the same in all of them."""
        specs = itertools.chain.from_iterable(self.action_sets.values())
        return {variable.name: variable for spec in specs for variable in spec.goal_variables}

    @cached_property
    def remote_calls(self) -> Mapping[str, RemoteCall]:
        """How the servers of remote actions are called, by the names of the actions of the default set."""
        specs = self.action_sets[DEFAULT_SET]
        return {spec.name: spec.remote for spec in specs if spec.remote is not None}

    @cached_property
    def ranges(self) -> Ranges:
        """The ranges of all goal variables that refinement may change: `variables` and the declared ones."""
        return {**self.variables, **declared_ranges(self.goal_variables.values())}

    @cached_property
    def known_features(self) -> Mapping[str, Feature]:
        """All features that model files may name: the general ones, the domain's own, its goal variables."""
        own = (*self.features, *map(goal_feature, self.goal_variables.values()))
        return {**GENERAL, **{feature.name: feature for feature in own}}

    @property
    def shipped_models(self) -> Path:
        """The folder of the models that are used where no other is named: a domain never uses another's."""
        models = resource_path("models")
        return models if self.name == DEFAULT else models / self.name

    def robot(self, path: Path | str | None = None) -> Robot:
        """Read a robot's description, by default the domain's or the shipped one, for this domain's scene.

        Raises
        ------
        ConfigError
            The file cannot be used, or its scene does not suit the domain.
        """
        path = path or self.description
        robot = load_robot(path)
        try:
            return self.equip(robot)
        except ConfigError as error:
            raise ConfigError(f"{path or 'the shipped robot'}: domain {self.name}: {error}") from error

    def equip(self, robot: Robot) -> Robot:
        """Return `robot` in this domain's scene.

        The area is the description's, and so are objects that it describes; the bays are the domain's.
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

    def remote_servers(self, action_set: str = DEFAULT_SET) -> tuple[str, ...]:
        """Return the names of the action servers of others that the actions of a set need."""
        remote = (spec.remote for spec in self.actions(action_set).values())
        return tuple(dict.fromkeys(call.server for call in remote if call is not None))

    def candidates(self, action: str, action_set: str = DEFAULT_SET) -> tuple[Feature, ...]:
        """Return the candidate features of an action, its goal variables among them.

        Where the domain names none, they are the general ones.
        """
        chosen = {spec.name: spec.features for spec in self.action_sets.get(action_set, ())}
        named = tuple(self.known_features[name] for name in chosen.get(action, ())) or CANDIDATES
        return (*named, *(own for own in self.goal_features(action, action_set) if own not in named))

    def goal_features(self, action: str, action_set: str = DEFAULT_SET) -> tuple[Feature, ...]:
        """Return the goal variables that an action declares, as features of its model."""
        declared = {spec.name: spec.goal_variables for spec in self.action_sets.get(action_set, ())}
        return tuple(self.known_features[direct_name(v.name)] for v in declared.get(action, ()))

    def source(self, name: str) -> ObjectSource:
        """Return where the state of an object comes from."""
        given = (source for source in self.sources if source.name == name)
        return next(given, ObjectSource(name, optional=True))

    def tops_for(self, robot: Robot) -> tuple[Top, ...]:
        """Return the TOPs with the tolerances and regions of a robot in its scene."""
        fitted = {top.name: top for top in self.fitted(robot)} if self.fitted else {}
        return tuple(fitted.get(top.name, top) for top in self.tops)

    def library(
        self, robot: Robot, action_set: str = DEFAULT_SET, factories: Mapping[str, ActionFactory] = NO_OTHERS
    ) -> TopLibrary:
        """Return the TOPs of the domain with the actions of one set; those without are left out.

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
        specs = self.actions(action_set)
        return TopLibrary(
            robot,
            action_set,
            tops=self.tops_for(robot),
            actions={name: factories.get(name, spec.factory) for name, spec in specs.items()},
            ranges=self.ranges,
            goal_variables={name: spec.goal_variables for name, spec in specs.items()},
        )


def installed_domains() -> dict[str, EntryPoint]:
    """Return the entry points of the domains that are installed, by name."""
    return {entry.name: entry for entry in entry_points(group=GROUP)}


def domain_for(name: str, robot: Path | str | None) -> Domain:
    """Return the domain of this name as `find_domain` does, or the one for a robot if `name` is empty.

    That is soccer if the robot has a holder and its scene has a ball, and otherwise `drive`.

    Parameters
    ----------
    name : str
        Name or file of the domain, or empty.
    robot : Path, str or None
        File of the robot's description; None or empty: the shipped one.
    """
    if name:
        return find_domain(name)
    soccer = find_domain(DEFAULT)
    try:
        described = load_robot(robot or None)
    except ConfigError:  # raised again where the file is read for the domain
        return soccer
    plays = described.holder is not None and described.scene.objects.keys() >= set(soccer.objects)
    return soccer if plays else find_domain(DRIVE)


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
