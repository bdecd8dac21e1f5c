"""Who takes which role: what each role costs each robot, and the assignment.

The result depends only on the arguments. Robots of a team that have received the same messages
therefore decide alike.
"""

from __future__ import annotations

import dataclasses
import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ator_ros.actions.goal_variables import with_values
from ator_ros.geometry import FloatArray, Pose
from ator_ros.refinement import RefinementError
from ator_ros.refinement.chain_prediction import ChainModel, GainError, error_of_sum
from ator_ros.refinement.gate import Gate
from ator_ros.refinement.objective import expected_time
from ator_ros.refinement.refiner import Refiner, choose
from ator_ros.team.assignment import Assignment, assign, waiting
from ator_ros.team.role_file import Role
from ator_ros.tops.chain import TopChain, projected
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.objects import at_object, at_rest, followed, is_at_front, missing_in
from ator_ros.world.state import ObjectState, World

SAME_FRAME = Pose(0.0, 0.0, 0.0)
"""The origin of roles that are in the frame of the robots."""
USUAL_GATE = Gate()


class Course(NamedTuple):
    """What a robot does in its role: where, and in how many s it is expected to be done.

    That was predicted when it began. Predictions from the middle of a drive would often include
    another approach.
    """

    places: tuple[tuple[float, float], ...]
    left: float

    def leads_to(
        self,
        places: Sequence[tuple[float, float]],
        distance: float,
    ) -> bool:
        """Return whether these are its places, up to a distance in m."""
        pairs = zip(self.places, places, strict=True)
        return all(math.dist(*pair) <= distance for pair in pairs)


@dataclass(frozen=True, slots=True)
class Member:
    """A robot of a team.

    Attributes
    ----------
    world : World
        Its state, and the objects that it observes itself.
    tops : frozenset of str
        The TOPs that it can execute.
    role : str
        The role that it holds; empty: none.
    barred : frozenset of str
        The roles that it must not take.
    course : Course or None
        What it does in the role that it holds.
    """

    name: str
    world: World
    tops: frozenset[str]
    role: str = ""
    barred: frozenset[str] = frozenset()
    course: Course | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Decision:
    """Who takes which role.

    Attributes
    ----------
    names : tuple of str
        The n robots in the order of their names.
    costs, errors : ndarray, shape (n, m)
        Predicted cost of each role for each robot, and what the models may be wrong by in its
        duration, in s; infinite where the robot cannot take the role.
    wanted : tuple of tuple of TopChain
        The chain of each role and its alternatives, before refinement.
    chains : tuple of tuple of TopChain or None
        The refined chain of each role for each robot. An empty chain: nothing is left to do.
    assignment : Assignment
        Roles by their indices. Its gain counts seconds by the weights of the roles.
    waiting : tuple of bool
        Whether each robot must not be sent, as a more important role needs its place.
    """

    names: tuple[str, ...]
    costs: FloatArray
    errors: FloatArray
    wanted: tuple[tuple[TopChain, ...], ...]
    chains: tuple[tuple[TopChain | None, ...], ...]
    assignment: Assignment
    waiting: tuple[bool, ...]

    def role_of(self, name: str) -> int | None:
        """Return the role of a robot."""
        return self.assignment.roles[self.names.index(name)]

    def chain_of(self, name: str) -> TopChain | None:
        """Return the chain of a robot's role; None if it has none, or must wait."""
        robot = self.names.index(name)
        role = self.assignment.roles[robot]
        return None if role is None or self.waiting[robot] else self.chains[robot][role]

    def goes_on(
        self,
        name: str,
        running: TopChain,
        distance: float,
    ) -> bool:
        """Return whether a running chain still ends where its role, or an alternative of it, does.

        The robot then goes on with it; places may differ by up to `distance` m.
        """
        role = self.role_of(name)
        end = running.calls[-1].goal.pose
        ends = [] if role is None else [chain.calls[-1].goal.pose for chain in self.wanted[role]]
        return any(each.distance(end) <= distance for each in ends)


def decide(
    members: Sequence[Member],
    roles: Sequence[Role],
    refiner: Refiner,
    library: TopLibrary,
    *,
    gate: Gate = USUAL_GATE,
    origin: Pose = SAME_FRAME,
) -> Decision:
    """Assign roles to the robots of a team.

    Parameters
    ----------
    members : sequence of Member
        The robots that can take a role, in any order.
    roles : sequence of Role
        The roles, the most important ones first.
    refiner : Refiner
        Predicts and refines the chains; without a gate, as there is no chain to compare with.
    library : TopLibrary
        The TOPs of the roles.
    gate : Gate
        Decides whether a change of roles pays.
    origin : Pose
        The frame of the roles, in that of the robots.
    """
    members = sorted(members, key=lambda member: member.name)
    objects = common_objects([member.world for member in members], library)
    wanted = [role.chains(library, objects, origin) for role in roles]
    offers = [_offers(member, roles, wanted, objects, refiner) for member in members]
    shape = (len(members), len(roles))
    costs = np.empty(shape)
    errors = np.empty(shape)
    for robot, row in enumerate(offers):
        for role, offer in enumerate(row):
            costs[robot, role] = offer.cost
            errors[robot, role] = offer.error

    def error_of(signs: FloatArray) -> GainError:
        models = []
        weighted = []
        for robot, role in np.argwhere(signs).tolist():
            model = offers[robot][role].model(refiner)
            if model is not None:
                models.append(model)
                weighted.append(signs[robot, role] * weights[role])
        return error_of_sum(models, weighted) if models else GainError()

    weights = np.array([role.weight for role in roles])
    numbers = {role.name: number for number, role in enumerate(roles)}
    held = [numbers.get(member.role) for member in members]
    found = assign(costs * weights, held, error_of, gate)
    ends = []
    for row, number in zip(offers, found.roles, strict=True):
        ends.append(row[0 if number is None else number].end(refiner))
    return Decision(
        tuple(member.name for member in members),
        costs,
        errors,
        tuple(map(tuple, wanted)),
        tuple(tuple(offer.chain for offer in row) for row in offers),
        found,
        waiting(found.roles, ends, 2.0 * refiner.robot.reach),
    )


def places_of(chains: Sequence[TopChain]) -> tuple[tuple[float, float], ...]:
    """Return the goals of a role's chain in m; none if an object is unknown."""
    goals = [call.goal.pose for chain in chains[:1] for call in chain.calls]
    return tuple((pose.x, pose.y) for pose in goals)


def common_objects(
    worlds: Sequence[World],
    library: TopLibrary,
) -> dict[str, ObjectState]:
    """Return where objects come to rest: the mean of the places that the robots observe.

    An object at the front of a robot moves with it, and is where the first such robot observes it.
    """
    robot = library.robot
    places: defaultdict[str, list[ObjectState]] = defaultdict(list)
    moved: dict[str, ObjectState] = {}
    for world in worlds:
        for name, there in at_rest(world, robot).objects.items():
            places[name].append(there)
            if robot.holder is not None and is_at_front(world, robot, name):
                moved.setdefault(name, world.objects[name])
    found = {}
    for name, observed in places.items():
        x = math.fsum(each.x for each in observed) / len(observed)
        y = math.fsum(each.y for each in observed) / len(observed)
        found[name] = ObjectState(x, y)
    return found | {name: ObjectState(each.x, each.y) for name, each in moved.items()}


@dataclass(frozen=True, slots=True)
class _Offer:
    """What a role costs a robot; `chain` is None if the robot cannot take it."""

    world: World
    chain: TopChain | None = None
    cost: float = math.inf
    error: float = math.inf

    def model(self, refiner: Refiner) -> ChainModel | None:
        """Return the prediction's model; None if nothing is left to do."""
        if not self.chain:
            return None
        return ChainModel(
            self.world,
            self.chain,
            refiner.robot,
            models=refiner.models,
            names=[()] * len(self.chain),
            objective=expected_time(refiner.failure_cost),
        )

    def end(self, refiner: Refiner) -> tuple[float, float]:
        """Return where the robot ends, in m."""
        world = self.world
        for call in self.chain.calls if self.chain else ():
            world = projected(world, call, refiner.robot)
        return world.robot.pose[:2]


def _offers(
    member: Member,
    roles: Sequence[Role],
    wanted: Sequence[Sequence[TopChain]],
    objects: Mapping[str, ObjectState],
    refiner: Refiner,
) -> list[_Offer]:
    """Return what each role costs a robot; the one that it holds as was predicted at its start."""
    found = []
    for role, chains in zip(roles, wanted, strict=True):
        allowed = [] if role.name in member.barred else chains
        offer = _offer(member, allowed, objects, refiner)
        course = member.course if role.name == member.role and offer.chain is not None else None
        if course is not None and course.leads_to(places_of(chains), refiner.robot.reach):
            offer = dataclasses.replace(offer, cost=min(offer.cost, course.left))
        found.append(offer)
    return found


def _offer(
    member: Member,
    chains: Sequence[TopChain],
    objects: Mapping[str, ObjectState],
    refiner: Refiner,
) -> _Offer:
    """Return what the best of a role's chains costs a robot."""
    observed = {name: objects[name] for name in member.world.objects}
    world = dataclasses.replace(member.world, objects=observed)
    nothing = _Offer(world)
    left = [what_is_left(chain, world, refiner) for chain in chains if _is_able(member, chain)]
    if any(not chain for chain in left):
        return _Offer(world, TopChain(()), 0.0, 0.0)
    usable: list[TopChain | str] = [chain for chain in left if not missing_in(chain.calls, world)]
    if not usable:
        return nothing
    try:
        found = choose(refiner, world, usable).refinement
    except RefinementError:
        return nothing
    return _Offer(world, found.chain, found.predicted.cost, found.predicted.error)


def _is_able(
    member: Member,
    chain: TopChain,
) -> bool:
    return {call.top.name for call in chain.calls} <= member.tops


def what_is_left(
    chain: TopChain,
    world: World,
    refiner: Refiner,
) -> TopChain:
    """Return the steps from the first one on whose post-condition does not hold.

    A chain whose last post-condition holds is done: the result is empty. An open heading is any.
    """
    done = []
    for call in chain.calls:
        goal = call.goal
        if call.opens("yaw"):
            goal = with_values(goal, {"yaw": world.robot.pose.yaw})
        unmet = missing_in([call], world) or call.top.unmet(world, goal, refiner.robot)
        done.append(not unmet)
    if done[-1]:
        return TopChain(())
    return chain.part(done.index(False))


def as_observed(
    chain: TopChain,
    world: World,
) -> TopChain:
    """Return a chain whose first step that follows an object leads to where `world` has it.

    The roles are decided for objects at rest where the team observes them in the mean. The executor
    expects, and follows, the place that its robot observes.
    """
    for index, call in enumerate(chain.calls):
        name = followed(call.top)
        if name is not None and name in world.objects:
            return chain.with_goal(index, at_object(call.goal, world, name))
    return chain
