"""A situation with a plan that can be edited."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from ator_ros.domains.domain import Domain
from ator_ros.domains.trials import open_speeds, possible_chain, random_trial
from ator_ros.geometry import Pose
from ator_ros.refinement.refiner import LONGEST_ALTERNATIVE, MOST_ALTERNATIVES
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.objects import followed
from ator_ros.world.state import ObjectState, RobotState, World

_MOVED = 0.01  # m or rad by which the robot must have moved for a new refinement
_SAME_PLACE = 0.15  # m up to which a goal counts as the place of the object that its step follows


@dataclass(frozen=True, slots=True)
class Draft:
    """A start at rest and a plan with open variables; each change returns a new draft.

    `action_set` executes the plan. Refinement may choose one of the `alternatives`, other chains
    for the same goal. `weights` are those of its objective by measure; the other measures have the
    usual weight.
    """

    world: World
    chain: TopChain
    action_set: str
    alternatives: tuple[TopChain, ...] = ()
    weights: Mapping[str, float] = field(default_factory=dict)

    def _with_calls(self, change: Callable[[TopCall], TopCall]) -> Draft:
        """Return the draft with a change of each call of each chain."""
        chain, *others = [
            TopChain(tuple(map(change, each.calls))) for each in (self.chain, *self.alternatives)
        ]
        return replace(self, chain=chain, alternatives=tuple(others))

    def with_robot(self, pose: Pose) -> Draft:
        """Return the draft with the robot at rest at `pose`."""
        world = replace(self.world, robot=RobotState(pose))
        return replace(self, world=world)

    def with_object(self, name: str, x: float, y: float) -> Draft:
        """Return the draft with an object, and the goals of steps that follow it, at (x, y) m."""
        before = self.world.objects.get(name)

        def moved(call: TopCall) -> TopCall:
            if before is None or not _follows(call, name, before):
                return call
            pose = call.goal.pose._replace(x=x, y=y)
            goal = replace(call.goal, pose=pose)
            return replace(call, goal=goal)

        world = self.world.with_object(name, ObjectState(x, y))
        return replace(self._with_calls(moved), world=world)

    def at(self, world: World) -> Draft:
        """Return the draft with robot and objects where they are in `world`, at rest."""
        draft = self
        for name, state in world.objects.items():
            draft = draft.with_object(name, state.x, state.y)
        return replace(draft, world=world).with_robot(world.robot.pose)

    def differs(self, other: Draft) -> bool:
        """Return whether robot, objects or chain differ so much that refinement is called again."""
        pose = self.world.robot.pose
        moved = other.world.robot.pose.relative(pose)
        return (
            math.hypot(moved.x, moved.y) > _MOVED
            or abs(moved.yaw) > _MOVED
            or self.chain != other.chain
            or set(self.world.objects) != set(other.world.objects)
        )

    def _with_call(self, step: int, **changes: Any) -> Draft:
        """Return the draft with changed fields of the call of a step (from 0)."""
        calls = list(self.chain.calls)
        calls[step] = replace(calls[step], **changes)
        return replace(self, chain=TopChain(tuple(calls)))

    def with_goal(self, step: int, pose: Pose) -> Draft:
        """Return the draft with the goal of a step (from 0) at `pose`."""
        goal = self.chain.calls[step].goal
        return self._with_call(step, goal=replace(goal, pose=pose))

    def with_open(self, step: int, name: str, is_open: bool) -> Draft:
        """Return the draft with a goal variable of a step (from 0) opened or bound."""
        names = self.chain.calls[step].open - {name}
        if is_open:
            names |= {name}
        return self._with_call(step, open=names)

    def with_library(self, library: TopLibrary) -> Draft:
        """Return the draft with the actions of another set."""

        def changed(call: TopCall) -> TopCall:
            top = library[call.top.name]
            goal = replace(call.goal, point=top.point)
            return replace(call, top=top, goal=goal)

        return replace(self._with_calls(changed), action_set=library.action_set)

    def with_weight(self, measure: str, weight: float) -> Draft:
        """Return the draft with the weight of a measure of performance."""
        return replace(self, weights={**self.weights, measure: weight})

    def with_alternative(self) -> Draft:
        """Return the draft with its chain as one more alternative; the newest ones are kept.

        Raises ValueError if the chain is too long for an alternative.
        """
        if len(self.chain) > LONGEST_ALTERNATIVE:
            raise ValueError(
                f"alternative: expected at most {LONGEST_ALTERNATIVE} steps, got {len(self.chain)}"
            )
        chains = dict.fromkeys((*self.alternatives, self.chain))
        return replace(self, alternatives=tuple(chains)[-MOST_ALTERNATIVES:])

    @property
    def movable_goals(self) -> Mapping[int, Pose]:
        """The goals by step, except those at the object that the step follows."""
        objects = self.world.objects
        return {
            step: call.goal.pose
            for step, call in enumerate(self.chain.calls)
            if not any(_follows(call, name, state) for name, state in objects.items())
        }


def _follows(call: TopCall, name: str, state: ObjectState) -> bool:
    """Return whether a step follows an object, and its goal is at the object."""
    if followed(call.top) != name:
        return False
    place = Pose(state.x, state.y, 0.0)
    return call.goal.pose.distance(place) <= _SAME_PLACE


def situation_draft(
    domain: Domain,
    library: TopLibrary,
    chain: str,
    *,
    seed: int,
    index: int,
) -> Draft:
    """Return a random situation of a chain of the domain."""
    trial = random_trial(domain, chain, library, seed=seed, index=index)
    return Draft(trial.world, open_speeds(trial.chain), library.action_set)


def first_draft(domain: Domain, library: TopLibrary) -> tuple[str, Draft]:
    """Return the name of the first chain whose steps all have actions, and its first situation."""
    actions = list(domain.actions(library.action_set))
    name = possible_chain(domain, library, None, actions) or next(iter(domain.chains))
    return name, situation_draft(domain, library, name, seed=0, index=0)
