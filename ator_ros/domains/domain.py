"""Domains, and how they are found: by entry points, or in YAML files."""

from __future__ import annotations

import dataclasses
import itertools
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from ator_ros.actions import DEFAULT_SET, TIME_LIMIT
from ator_ros.actions.base import Point
from ator_ros.actions.goal_variables import (
    GOAL_VARIABLES,
    MOST_GOAL_VARIABLES,
    STOP,
    GoalVariable,
    direct_name,
)
from ator_ros.actions.remote import UnreachableAction
from ator_ros.actions.situation import ActionFactory, ActionSpec, Sampler, Situation
from ator_ros.bases.description import ConfigError, Robot, load_robot
from ator_ros.bases.routes import routes_of
from ator_ros.domains import DEFAULT, DRIVE
from ator_ros.domains.declared import DeclaredAction, DeclaredDomain, DeclaredServer
from ator_ros.files import FileError, content_with_optional_header, read_yaml
from ator_ros.performance.features import (
    CANDIDATES,
    GENERAL,
    PASSING_FEATURES,
    ROUTE_FEATURES,
    Feature,
    goal_feature,
)
from ator_ros.printable import ReadableError, listed, printable, quoted
from ator_ros.resources import resource_path
from ator_ros.schema import SchemaError, require, structured
from ator_ros.tops.chain import Top, TopChain
from ator_ros.tops.conditions import Condition, state_variables
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.objects import objects_in
from ator_ros.tops.ranges import USUAL_RANGES, Ranges, declared_ranges
from ator_ros.world.grid_map import GridMap, Planner, load_map
from ator_ros.world.readers import ObjectSource
from ator_ros.world.scene import Bay, RoundObject, Scene
from ator_ros.world.state import World

GROUP = "ator_ros.domains"
"""Group of entry points: the installed domains."""
ACTION_SETS = "ator_ros.action_sets"
"""Group of entry points: further action sets of installed domains, each named DOMAIN.SET."""
STAND_INS = "ator_ros.stand_ins"
"""Group of entry points: actions that replace action servers in simulations without ROS."""
PLANNERS = "ator_ros.planners"
"""Group of entry points: functions that return the planner of a map for a robot."""
_LONGEST_REASON = 200  # characters
_LARGEST_FILE = 200_000  # bytes; a file with a dozen TOPs has 5 kB
_ENDINGS = (".yaml", ".yml")
_NONE: Mapping[str, ActionFactory] = MappingProxyType({})

ChainSampler = Callable[[Robot, TopLibrary, np.random.Generator], tuple[World, TopChain]]
Line = Sequence[tuple[float, float]]
"""The corners of a line on the floor, x and y in m."""


class DomainError(ReadableError, ValueError):
    """A domain that cannot be used."""

    longest = 400  # names the state variables that a condition may have


@dataclass(frozen=True)
class Domain:
    """TOPs, actions that execute them, and situations in which these are learned and evaluated.

    Attributes
    ----------
    tops : tuple of Top
        The TOPs that plans consist of, with the tolerances for a usual robot; see `tops_for`.
    action_sets : mapping of str to tuple of ActionSpec
        Sets of actions by name, "default" among them. A set may lack the action of a TOP; see
        `library`.
    objects : tuple of str
        Names of the objects that conditions name; each has a topic of that name.
    chains : mapping of str to callable
        Samplers of situations with a chain to execute, by name; evaluations need one.
    variables : mapping of str to callable
        Ranges of the goal variables that refinement may change where a plan opens them: by default
        place, heading and arrival speed, in the scene's area and within the robot's limits. Those
        that actions declare (`ActionSpec.goal_variables`) are added.
    bodies : mapping of str to RoundObject
        Sizes of objects that a robot's description lacks, by name. An object without a size is a
        point, and not simulated.
    bays : callable
        Returns the bays of a scene for this domain; raises ConfigError if the scene is unsuitable.
    sources : tuple of ObjectSource
        Topics of objects; an object without one has the topic of its name, with Odometry.
    features : tuple of Feature
        The features that the domain adds to the general ones.
    description : Path or None
        File of the default robot and its scene; None: the shipped one.
    lines : callable
        Returns the lines on the floor that a view draws beside the scene's area and bays.
    servers : tuple of DeclaredServer
        Action servers that tools start with our nodes.
    time_limit : float
        Time in s that an action or a chain may take in a simulation without ROS.
    goals : callable
        Returns, for a robot in its scene, the goals of plans by name: conditions whose targets are
        numbers or state variables.
    fitted : callable, optional
        Returns TOPs with the tolerances and regions of a robot and its scene, which replace those
        in `tops`.
    grid : GridMap or None
        The map of the building; see `on_map`.
    planner : callable, optional
        Returns, for a map and a robot, what plans the routes on it; see `GridMap.planner`.

    Raises
    ------
    DomainError
        The parts do not agree, as when a condition names an object that `objects` lacks.
    """

    name: str
    tops: tuple[Top, ...]
    action_sets: Mapping[str, tuple[ActionSpec, ...]]
    objects: tuple[str, ...] = ()
    chains: Mapping[str, ChainSampler] = field(default_factory=dict)
    variables: Ranges = field(default_factory=lambda: USUAL_RANGES)
    bodies: Mapping[str, RoundObject] = field(default_factory=dict)
    bays: Callable[[Scene], tuple[Bay, ...]] = lambda _: ()
    sources: tuple[ObjectSource, ...] = ()
    features: tuple[Feature, ...] = ()
    description: Path | None = None
    lines: Callable[[Robot], Sequence[Line]] = lambda _: ()
    servers: tuple[DeclaredServer, ...] = ()
    time_limit: float = TIME_LIMIT
    goals: Callable[[Robot], Mapping[str, Condition]] = lambda _: {}
    fitted: Callable[[Robot], tuple[Top, ...]] | None = None
    grid: GridMap | None = None
    planner: Callable[[GridMap, Robot], Planner] | None = None

    def __post_init__(self) -> None:
        try:
            self._check_objects_and_features()
            for top in self.tops:
                for part, condition in (("pre", top.pre), ("post", top.post)):
                    self._check_condition(f"tops.{top.name}.{part}", condition, top.action)
        except ValueError as error:
            raise DomainError(f"domain {self.name}: {error}") from error

    def _check_objects_and_features(self) -> None:
        sets = self.action_sets
        objects = {name for top in self.tops for name in objects_in(top)}
        require(DEFAULT_SET in sets, "action sets", f"{DEFAULT_SET!r} among them", sorted(sets))
        unknown = objects.union(source.name for source in self.sources).difference(self.objects)
        also = f"also {', '.join(sorted(unknown))}, as conditions or sources name them"
        require(not unknown, "objects", also, self.objects)
        own = (direct_name(name) for name in self.goal_variables)
        features = Counter((*GENERAL, *(feature.name for feature in self.features), *own))
        twice = [name for name, count in features.items() if count > 1]
        require(not twice, "features", "each name once", twice)
        for action_set, specs in sets.items():
            for spec in specs:
                place = f"action set {action_set!r}: {spec.name}"
                strange = [name for name in spec.features if name not in features]
                require(not strange, f"{place}: features", f"some of {listed(features)}", strange)
                names = [variable.name for variable in spec.goal_variables]
                few = len(names) <= MOST_GOAL_VARIABLES
                require(few, f"{place}: goal_variables", f"at most {MOST_GOAL_VARIABLES}", names)
                for variable in spec.goal_variables:
                    same = self.goal_variables[variable.name] == variable
                    expected = f"the same {variable.name} in all actions"
                    require(same, f"{place}: goal_variables", expected, variable)
                for filling in spec.remote.goal if spec.remote else ():
                    name = filling.goal_variable
                    known = (*GOAL_VARIABLES, *names)
                    require(
                        name in (None, *known), f"{place}: goal", f"one of {', '.join(known)}", name
                    )

    def _check_condition(self, place: str, condition: Condition, action: str) -> None:
        state = state_variables(self.objects)
        known = [
            {*GOAL_VARIABLES, *(variable.name for variable in spec.goal_variables)}
            for specs in self.action_sets.values()
            for spec in specs
            if spec.name == action  # without any the TOP is left out
        ]
        goal = [f"goal.{name}" for name in sorted(set.intersection(*known))] if known else []
        for number, term in enumerate(condition.terms):
            where = f"{place}[{number}]"
            target = term.target
            require(
                term.variable in state,
                f"{where}.variable",
                f"one of {', '.join(state)}",
                term.variable,
            )
            if isinstance(target, str) and (known or not target.startswith("goal.")):
                good = target in state or target in goal
                require(good, f"{where}.target", f"one of {', '.join((*state, *goal))}", target)

    @cached_property
    def goal_variables(self) -> Mapping[str, GoalVariable]:
        """The goal variables that actions declare, by name."""
        specs = itertools.chain.from_iterable(self.action_sets.values())
        return {variable.name: variable for spec in specs for variable in spec.goal_variables}

    @cached_property
    def ranges(self) -> Ranges:
        """The ranges of `variables` and of the goal variables that actions declare."""
        return {**self.variables, **declared_ranges(self.goal_variables.values())}

    @cached_property
    def known_features(self) -> Mapping[str, Feature]:
        """All features that model files may name: general ones, the domain's, goal variables."""
        passing = PASSING_FEATURES if STOP in self.goal_variables else ()
        variables = map(goal_feature, self.goal_variables.values())
        own = (*self.features, *variables, *passing, *self._of_map)
        return {**GENERAL, **{feature.name: feature for feature in own}}

    @cached_property
    def _of_map(self) -> tuple[Feature, ...]:
        return () if self.grid is None else ROUTE_FEATURES

    def with_action_sets(self, further: Mapping[str, tuple[ActionSpec, ...]]) -> Domain:
        """Return this domain with further action sets, by name.

        Raises
        ------
        DomainError
            A set has the name of one that the domain already has, or does not suit its TOPs.
        """
        twice = sorted(further.keys() & self.action_sets.keys())
        if twice:
            raise DomainError(
                f"action sets of {self.name}: expected each name once, got {', '.join(twice)} twice"
            )
        return dataclasses.replace(self, action_sets={**self.action_sets, **further})

    def on_map(self, grid: GridMap | Path | str) -> Domain:
        """Return this domain on a map or on that of a map_server file; itself for an empty name.

        Raises
        ------
        FileError
            The file cannot be used.
        """
        if not grid:
            return self
        return dataclasses.replace(self, grid=grid if isinstance(grid, GridMap) else load_map(grid))

    @property
    def shipped_models(self) -> Path:
        """The default folder of this domain's models."""
        models = resource_path("models")
        return models if self.name == DEFAULT else models / self.name

    def models_root(self, folder: Path | str | None) -> Path:
        """Return a folder of models; None or empty: the shipped one."""
        return Path(folder or self.shipped_models)

    def robot(self, path: Path | str | None = None) -> Robot:
        """Read a robot's description, by default the domain's or the shipped one, for this scene.

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
            raise ConfigError(
                f"{path or 'the shipped robot'}: domain {self.name}: {error}"
            ) from error

    def equip(self, robot: Robot) -> Robot:
        """Return `robot` in this domain's scene: its objects, bays and map, the area as described.

        Objects that the robot's description contains have precedence over `bodies`. Raises
        FileError if no place on the map has room for the robot.
        """
        known = {**self.bodies, **robot.scene.objects}
        objects = {name: known[name] for name in self.objects if name in known}
        scene = dataclasses.replace(robot.scene, objects=objects, bays=self.bays(robot.scene))
        grid = self.grid
        if grid is not None and self.planner is not None:
            grid = dataclasses.replace(grid, planner=self.planner(grid, robot))
        equipped = dataclasses.replace(robot, scene=scene, grid=grid)
        routes_of(equipped)  # which checks the map
        return equipped

    def actions(self, action_set: str = DEFAULT_SET) -> dict[str, ActionSpec]:
        """Return the specifications of a set by the names of the actions.

        Raises
        ------
        DomainError
            There is no such set.
        """
        if action_set not in self.action_sets:
            sets = sorted(self.action_sets)
            raise DomainError(
                f"action set of {self.name}: expected one of {sets}, got {action_set!r}"
            )
        return {spec.name: spec for spec in self.action_sets[action_set]}

    def remote_servers(self, action_set: str = DEFAULT_SET) -> tuple[str, ...]:
        """Return the names of the action servers that the actions of a set need."""
        remote = (spec.remote for spec in self.actions(action_set).values())
        servers = (each.server for call in remote if call is not None for each in call.servers)
        return tuple(dict.fromkeys(servers))

    def candidates(self, action: str, action_set: str = DEFAULT_SET) -> tuple[Feature, ...]:
        """Return the candidate features of an action: its specification's, or the general ones.

        Features of its goal variables and of the map are added.
        """
        spec = {spec.name: spec for spec in self.action_sets.get(action_set, ())}.get(action)
        if spec is None:
            return (*CANDIDATES, *self._of_map)
        named = tuple(self.known_features[name] for name in spec.features) or CANDIDATES
        variables = [variable.name for variable in spec.goal_variables]
        own = [self.known_features[direct_name(name)] for name in variables]
        if STOP in variables:
            own += [self.known_features[feature.name] for feature in PASSING_FEATURES[1:]]
        return (*named, *(feature for feature in own if feature not in named), *self._of_map)

    def source(self, name: str) -> ObjectSource:
        """Return the topic of an object's state."""
        given = (source for source in self.sources if source.name == name)
        return next(given, ObjectSource(name, optional=True))

    def tops_for(self, robot: Robot) -> tuple[Top, ...]:
        """Return the TOPs with the tolerances and regions of a robot in its scene."""
        fitted = {top.name: top for top in self.fitted(robot)} if self.fitted else {}
        return tuple(fitted.get(top.name, top) for top in self.tops)

    def library(
        self,
        robot: Robot,
        action_set: str = DEFAULT_SET,
        factories: Mapping[str, ActionFactory] = _NONE,
    ) -> TopLibrary:
        """Return the TOPs with the actions of one set; TOPs whose action it lacks are left out.

        `factories` replace those of the specifications, by the names of the actions.

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


def entry_points_of(group: str) -> dict[str, EntryPoint]:
    """Return the entry points of a group by name."""
    return {entry.name: entry for entry in entry_points(group=group)}


def domain_for(name: str, robot: Path | str | None) -> Domain:
    """Return the domain of this name as `find_domain` does; by default the one that suits a robot.

    That is soccer if the robot has a holder and its scene has a ball, and otherwise `drive`.
    `robot` is the file of its description; None or empty: the shipped one.
    """
    if name:
        return find_domain(name)
    soccer = find_domain(DEFAULT)
    try:
        described = load_robot(robot or None)
    except ConfigError:  # raised again when the file is read for the domain
        return soccer
    plays = described.holder is not None and described.scene.objects.keys() >= set(soccer.objects)
    return soccer if plays else find_domain(DRIVE)


def find_domain(name: str = DEFAULT) -> Domain:
    """Return an installed domain by its name, or one from a YAML file by the path of the file.

    Raises
    ------
    DomainError
        There is no such domain, or it cannot be used.
    """
    if "/" in name or name.endswith(_ENDINGS):
        domain = declared_domain(Path(name))
        if domain.name in entry_points_of(GROUP):
            raise DomainError(
                f"{name}: name: expected none of the installed domains, "
                f"whose models have that name, got {domain.name!r}"
            )
        return domain
    return _installed(name)


def _installed(name: str) -> Domain:
    domain = _loaded(GROUP, name, "domain")
    if not isinstance(domain, Domain):
        raise DomainError(f"domain {name}: expected a Domain, got {type(domain).__name__}")
    prefix = f"{name}."
    entries = [entry for entry in entry_points_of(ACTION_SETS) if entry.startswith(prefix)]
    further = {entry.removeprefix(prefix): _loaded_action_set(entry) for entry in entries}
    return domain.with_action_sets(further) if further else domain


def _loaded_action_set(entry: str) -> tuple[ActionSpec, ...]:
    specs = _loaded(ACTION_SETS, entry, "action set")
    if isinstance(specs, tuple) and all(isinstance(spec, ActionSpec) for spec in specs):
        return specs
    raise DomainError(
        f"action set {entry}: expected a tuple of ActionSpec, got {type(specs).__name__}"
    )


def _loaded(group: str, name: str, place: str) -> Any:
    """Import the entry point of this name.

    Raise DomainError if it is missing or the import fails.
    """
    found = entry_points_of(group)
    if name not in found:
        expected = f"an entry point of {group}, one of {sorted(found)}"
        raise DomainError(f"{place}: expected {expected}, got {quoted(name)}")
    try:
        return found[name].load()
    except Exception as error:  # a module from outside raises anything
        why = printable(f"{type(error).__name__}: {error}", _LONGEST_REASON)
        raise DomainError(
            f"{place} {name}: expected to import {found[name].value}, got {why}"
        ) from error


def declared_domain(path: Path) -> Domain:
    """Read a domain from a YAML file (docs/remote_actions.md).

    It may have the name of an installed one.

    Raises
    ------
    DomainError
        The file cannot be used.
    """
    try:
        data = content_with_optional_header(read_yaml(path, largest=_LARGEST_FILE), "domain")
        return _made(structured(data, DeclaredDomain), path)
    except FileError as error:
        raise DomainError(str(error)) from error
    except (SchemaError, DomainError) as error:
        raise DomainError(f"{path}: {error}") from error


def _made(declared: DeclaredDomain, path: Path) -> Domain:
    points = {top.action: Point(top.point) for top in reversed(declared.tops)}
    variables = declared.variables
    limit = declared.time_limit
    specs: list[ActionSpec] = []
    features: dict[str, Feature] = {}
    for number, action in enumerate(declared.actions):
        where = f"actions[{number}]"
        if action.local is None:
            specs.append(_remote_spec(action, points.get(action.name, Point.AXLE), limit, where))
            continue
        try:
            domain = _installed(action.local.domain)  # a file may name itself
            found = domain.actions(action.local.action_set)
        except DomainError as error:
            raise DomainError(f"{where}.local: {error}") from error
        if action.name not in found:
            raise DomainError(
                f"{where}.name: expected one of {', '.join(found)}, got {action.name!r}"
            )
        specs.append(found[action.name])
        features |= {item.name: item for item in domain.features if item.name in specs[-1].features}
    return Domain(
        declared.name,
        tops=tuple(top.top() for top in declared.tops),
        action_sets={DEFAULT_SET: tuple(specs)},
        objects=tuple(item.name for item in declared.objects),
        chains={chain.name: partial(chain.sample, time_limit=limit) for chain in declared.chains},
        sources=declared.objects,
        variables=USUAL_RANGES
        if variables is None
        else {item.name: item.range for item in variables},
        features=tuple(features.values()),
        bays=lambda scene: scene.bays if declared.bays else (),
        description=None if declared.robot is None else path.parent / declared.robot,
        servers=tuple(server.beside(path) for server in declared.servers),
        time_limit=limit,
        grid=None if declared.map is None else load_map(path.parent / declared.map),
        planner=None
        if declared.planner is None
        else _loaded(PLANNERS, declared.planner, "planner"),
    )


def _remote_spec(action: DeclaredAction, point: Point, time_limit: float, where: str) -> ActionSpec:
    name = action.name
    variables = action.all_variables
    factory: ActionFactory = UnreachableAction
    if action.stand_in is not None:
        factory = _loaded(STAND_INS, action.stand_in, f"{where}.stand_in")
    sample: Sampler = _no_sampler
    if action.drives is not None:
        sample = partial(action.drives.sample, name, point, variables, time_limit=time_limit)
    return ActionSpec(name, factory, sample, remote=action.remote, goal_variables=variables)


def _no_sampler(_robot: Robot, _rng: np.random.Generator) -> Situation:
    raise DomainError(
        "an action on a server is recorded by the executor: "
        "expected `drives` in the domain's file to collect it, got none"
    )
