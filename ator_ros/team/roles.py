"""Who takes which role: what each role costs a robot, and the assignment.

Each robot predicts what the roles cost it by its own models, and publishes that. The assignment
depends only on what the robots publish, so that those that received the same messages decide alike.
"""

from __future__ import annotations

import dataclasses
import math
from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ator_ros.actions.goal_variables import with_values
from ator_ros.bases.description import Robot
from ator_ros.geometry import Pose
from ator_ros.refinement import RefinementError
from ator_ros.refinement.gate import Gate
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


class Bid(NamedTuple):
    """What a role costs a robot, as the robot itself predicts it.

    Attributes
    ----------
    cost, error : float
        The predicted cost of the refined chain, and what the models may be wrong by in its
        duration, in s.
    end : tuple of float
        Where the robot ends, in m.
    """

    cost: float
    error: float
    end: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Member:
    """A robot of a team, as it describes itself.

    Attributes
    ----------
    world : World
        Its state, and the objects that it observes.
    reach : float
        From the center of its axle to its farthest part, in m.
    role : str
        The role that it holds; empty: none.
    bids : mapping of str to Bid
        What each role that it can take costs it, by the name of the role.
    """

    name: str
    world: World
    reach: float
    role: str = ""
    bids: Mapping[str, Bid] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Plan:
    """How a robot would act in a role.

    Attributes
    ----------
    wanted : tuple of TopChain
        The role's chain and its alternatives, before refinement.
    chain : TopChain or None
        The refined chain; None if the robot cannot take the role. Empty: nothing is left to do.
    bid : Bid or None
        What the chain costs; None if there is none.
    """

    wanted: tuple[TopChain, ...]
    chain: TopChain | None = None
    bid: Bid | None = None

    @property
    def places(self) -> tuple[tuple[float, float], ...]:
        """The goals of the role's chain in m; none if an object is unknown."""
        goals = [call.goal.pose for chain in self.wanted[:1] for call in chain.calls]
        return tuple((pose.x, pose.y) for pose in goals)

    def goes_on(
        self,
        running: TopChain,
        distance: float,
    ) -> bool:
        """Return whether a running chain still ends where the role, or an alternative of it, does.

        The robot then goes on with it; places may differ by up to `distance` m.
        """
        end = running.calls[-1].goal.pose
        ends = [chain.calls[-1].goal.pose for chain in self.wanted]
        return any(each.distance(end) <= distance for each in ends)


class Course(NamedTuple):
    """A role that a robot has begun: its places in m, and the time in s when it should be done.

    The time was predicted at the beginning. Predictions from the middle of a drive would often
    include another approach.
    """

    role: str
    places: tuple[tuple[float, float], ...]
    end: float

    def leads_to(
        self,
        places: Sequence[tuple[float, float]],
        distance: float,
    ) -> bool:
        """Return whether these are its places, up to a distance in m."""
        pairs = zip(self.places, places, strict=True)
        return all(math.dist(*pair) <= distance for pair in pairs)


def course_in(
    role: str,
    plan: Plan,
    before: Course | None,
    time: float,
    distance: float,
) -> Course | None:
    """Return the course of a robot that has a role at a time in s; None if it cannot take it.

    The expected end stays that of the course before, unless the role is another one, that end has
    passed, or a place of the role is more than `distance` m elsewhere.
    """
    if plan.bid is None:
        return None
    course = Course(role, plan.places, time + plan.bid.cost)
    if before is None or before.role != role or before.end <= time:
        return course
    if before.leads_to(plan.places, distance):
        return course._replace(end=before.end)  # also where an object moves with the robot
    return course


@dataclass(frozen=True, slots=True)
class Decision:
    """Who takes which role.

    Attributes
    ----------
    names : tuple of str
        The n robots in the order of their names.
    assignment : Assignment
        Roles by their indices. Its gain counts seconds by the weights of the roles.
    waiting : tuple of bool
        Whether each robot must not be sent, as a more important role needs its place.
    """

    names: tuple[str, ...]
    assignment: Assignment
    waiting: tuple[bool, ...]

    def role_of(self, name: str) -> int | None:
        """Return the role of a robot."""
        return self.assignment.roles[self.names.index(name)]

    def waits(self, name: str) -> bool:
        """Return whether a robot must not be sent."""
        return self.waiting[self.names.index(name)]


def decide(
    members: Sequence[Member],
    roles: Sequence[Role],
    gate: Gate = USUAL_GATE,
    may_change: Collection[str] | None = None,
) -> Decision:
    """Assign roles to the robots of a team by what they cost each robot.

    Parameters
    ----------
    members : sequence of Member
        The robots that can take a role, in any order.
    roles : sequence of Role
        The roles, the most important ones first.
    gate : Gate
        Decides whether a change of roles pays.
    may_change : collection of str, optional
        The robots whose roles may change because it pays; None: all.
    """
    members = sorted(members, key=lambda member: member.name)
    shape = (len(members), len(roles))
    costs = np.full(shape, np.inf)
    errors = np.full(shape, np.inf)
    for row, member in enumerate(members):
        for column, role in enumerate(roles):
            if bid := member.bids.get(role.name):
                costs[row, column] = role.weight * bid.cost
                errors[row, column] = role.weight * bid.error
    numbers = {role.name: number for number, role in enumerate(roles)}
    held = [numbers.get(member.role) for member in members]
    may = [may_change is None or member.name in may_change for member in members]
    found = assign(costs, errors, held, gate, may)
    ends = [
        member.world.robot.pose[:2] if number is None else member.bids[roles[number].name].end
        for member, number in zip(members, found.roles, strict=True)
    ]
    return Decision(
        tuple(member.name for member in members),
        found,
        waiting(found.roles, ends, [member.reach for member in members]),
    )


def common_objects(
    members: Sequence[Member],
    robot: Robot,
) -> dict[str, ObjectState]:
    """Return where objects come to rest: the mean of the places that the robots observe.

    An object at the front of a robot moves with it, and is where the first such robot by name
    observes it. `robot` describes how objects roll, and where the front is.
    """
    places: defaultdict[str, list[ObjectState]] = defaultdict(list)
    moved: dict[str, ObjectState] = {}
    for member in sorted(members, key=lambda member: member.name):
        world = member.world
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


def plan_roles(
    world: World,
    roles: Sequence[Role],
    refiner: Refiner,
    library: TopLibrary,
    objects: Mapping[str, ObjectState],
    *,
    origin: Pose = SAME_FRAME,
    barred: Collection[str] = (),
    course: Course | None = None,
) -> dict[str, Plan]:
    """Return how a robot would act in each role, by the name of the role.

    Parameters
    ----------
    world : World
        The robot's state, and the objects that it observes.
    refiner : Refiner
        Predicts and refines its chains; without a gate, as there is no chain to compare with.
    library : TopLibrary
        The TOPs of the roles.
    objects : mapping of str to ObjectState
        Where the team observes the objects at rest (`common_objects`).
    origin : Pose
        The frame of the roles, in that of the robot.
    barred : collection of str
        The roles that the robot must not take.
    course : Course, optional
        What it has begun: this role costs at most what was predicted at the beginning.
    """
    observed = {name: objects[name] for name in world.objects}
    at_places = dataclasses.replace(world, objects=observed)
    usable = {top.name for top in library.usable()}
    plans = {}
    for role in roles:
        wanted = tuple(role.chains(library, objects, origin))
        able = [chain for chain in wanted if {call.top.name for call in chain.calls} <= usable]
        plan = _plan(wanted, [] if role.name in barred else able, at_places, refiner)
        if course is not None and course.role == role.name:
            plan = _as_begun(plan, course, world.time, refiner.robot.reach)
        plans[role.name] = plan
    return plans


def bids_of(plans: Mapping[str, Plan]) -> dict[str, Bid]:
    """Return what the roles cost that a robot can take."""
    return {role: plan.bid for role, plan in plans.items() if plan.bid is not None}


def _plan(
    wanted: tuple[TopChain, ...],
    able: Sequence[TopChain],
    world: World,
    refiner: Refiner,
) -> Plan:
    """Return the plan with the best of the chains that the robot is able to execute."""
    nothing = Plan(wanted)
    left = [what_is_left(chain, world, refiner) for chain in able]
    if any(not chain for chain in left):
        return Plan(wanted, TopChain(()), Bid(0.0, 0.0, world.robot.pose[:2]))
    chains: list[TopChain | str] = [chain for chain in left if not missing_in(chain.calls, world)]
    if not chains:
        return nothing
    try:
        found = choose(refiner, world, chains).refinement
    except RefinementError:
        return nothing
    predicted = found.predicted
    if not math.isfinite(predicted.cost):
        return nothing
    end = world
    for call in found.chain.calls:
        end = projected(end, call, refiner.robot)
    return Plan(wanted, found.chain, Bid(predicted.cost, predicted.error, end.robot.pose[:2]))


def _as_begun(
    plan: Plan,
    course: Course,
    time: float,
    distance: float,
) -> Plan:
    """Return the plan with at most the cost that was predicted when the robot began it."""
    if plan.bid is None or course.end <= time or not course.leads_to(plan.places, distance):
        return plan
    cost = min(plan.bid.cost, course.end - time)
    return dataclasses.replace(plan, bid=plan.bid._replace(cost=cost))


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
