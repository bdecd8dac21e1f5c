"""Random situations with a chain to execute in them (paper, section 5)."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ator_ros.actions.goal_variables import wrong_values
from ator_ros.actions.situation import drawn_until
from ator_ros.bases.description import ConfigError, Robot
from ator_ros.bases.routes import reachable
from ator_ros.domains.domain import Domain, DomainError
from ator_ros.geometry import Pose
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import LeftOutError, TopLibrary
from ator_ros.world.state import World


@dataclass(frozen=True, slots=True)
class Trial:
    """One situation: initial state, and plan with open variables."""

    world: World
    chain: TopChain


def random_trial(
    domain: Domain,
    chain: str,
    library: TopLibrary,
    *,
    seed: int,
    index: int,
) -> Trial:
    """Draw situation `index` of a domain's chain.

    The same seed gives the same situation.

    Parameters
    ----------
    domain : Domain
        The domain.
    chain : str
        Name of one of its chains.
    library : TopLibrary
        TOPs and actions of the chain.
    seed, index : int
        Seed of the situations, and number of the situation.

    Raises
    ------
    DomainError
        A goal lacks a variable that its action declares, or has an undeclared one.
    LeftOutError
        The chain needs a TOP whose action the library's set lacks.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(index,)))
    try:
        world, plan = drawn_until(
            lambda: domain.chains[chain](library.robot, library, rng),
            lambda found: reachable(_places(*found, library.robot), library.robot),
            lambda: f"chain {chain}: expected free places with routes between them on the map",
        )
    except LeftOutError as error:
        raise LeftOutError(f"chain {chain} of {domain.name}: {error}") from None
    for step, call in enumerate(plan.calls, start=1):
        if wrong := wrong_values(call.goal, library.goal_variables(call.top)):
            raise DomainError(
                f"chain {chain} of {domain.name}: step {step} ({call.top.name}): {wrong}"
            )
    return Trial(world, plan)


def _places(
    world: World,
    chain: TopChain,
    robot: Robot,
) -> list[Pose]:
    arriving = (call.goal for call in chain.calls if call.top.arrives)
    return [world.robot.pose, *(goal.robot_pose(robot) for goal in arriving)]


def reopened(chain: TopChain, opened: Iterable[frozenset[str]]) -> TopChain:
    """Return the chain with these open variables, call by call."""
    pairs = zip(chain.calls, opened, strict=True)
    return TopChain(tuple(dataclasses.replace(call, open=names) for call, names in pairs))


def open_speeds(chain: TopChain) -> TopChain:
    """Return the chain with the arrival speeds at its intermediate subgoals open too."""
    *intermediate, last = (call.open for call in chain.calls)
    opened = [names | {"speed"} for names in intermediate]
    return reopened(chain, (*opened, last))


def open_places(chain: TopChain) -> TopChain:
    """Return the chain with speeds open, and poses open before steps that may start in a region."""
    opened = [call.open for call in open_speeds(chain).calls]
    for index, following in enumerate(chain.calls[1:]):
        if following.top.pre.relations:
            opened[index] |= {"x", "y", "yaw"}
    return reopened(chain, opened)


def with_headings(chain: TopChain, headings: Mapping[int, float]) -> TopChain:
    """Return the chain with fixed headings (rad) at some subgoals."""
    calls = list(chain.calls)
    for index, yaw in headings.items():
        call = calls[index]
        pose = call.goal.pose._replace(yaw=float(yaw))
        goal = dataclasses.replace(call.goal, pose=pose)
        calls[index] = dataclasses.replace(
            call,
            goal=goal,
            open=call.open - {"yaw"},
        )
    return TopChain(tuple(calls))


def possible_actions(
    domain: Domain, action_set: str, robot: Robot, *, over_ros: bool = False
) -> tuple[list[str], dict[str, str]]:
    """Return the actions of a set that a robot can execute.

    Parameters
    ----------
    domain : Domain
        The domain.
    action_set : str
        Name of one of its action sets.
    robot : Robot
        The robot.
    over_ros : bool
        Whether actions that are executed over ROS count too.

    Returns
    -------
    possible : list of str
        Names of the actions, in the order of the set.
    left_out : dict of str to str
        Why the robot cannot execute the others.
    """
    library = domain.library(robot, action_set)
    reasons = library.left_out  # by TOP
    left_out = {top.action: reasons[top.name] for top in domain.tops if top.name in reasons}
    actions_of_tops = {top.action for top in domain.tops}
    for name, spec in domain.actions(action_set).items():
        if name not in actions_of_tops:
            others = ", ".join(sorted(actions_of_tops))
            left_out[name] = f"expected a TOP with the action {name}, got TOPs with {others}"
        elif not over_ros and spec.over_ros_only is not None:
            left_out[name] = spec.over_ros_only
        elif name not in left_out:
            try:
                spec.factory(robot)
                spec.situation(robot, np.random.default_rng(0))
            except ConfigError as error:
                left_out[name] = str(error)
    return [name for name in domain.actions(action_set) if name not in left_out], left_out


def possible_chain(
    domain: Domain,
    library: TopLibrary,
    wanted: str | None,
    actions: Sequence[str],
) -> str | None:
    """Return the name of a chain that consists of possible actions.

    It is the wanted chain if that is possible, else the first of the domain; None if every chain
    needs another action.

    Parameters
    ----------
    domain : Domain
        The domain.
    library : TopLibrary
        TOPs and actions.
    wanted : str or None
        Name of the preferred chain.
    actions : sequence of str
        Names of the possible actions.
    """
    for name in sorted(domain.chains, key=lambda name: name != wanted):
        try:
            trial = random_trial(domain, name, library, seed=0, index=0)
        except ConfigError:
            continue
        if all(call.top.action in actions for call in trial.chain.calls):
            return name
    return None
