"""Refinement of a goal's chain: before it starts, and again when the world has changed."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ator_ros.actions.goal_variables import goal_values, with_values
from ator_ros.execution.chain_executor import ChainExecutor
from ator_ros.geometry import FloatArray, Pose
from ator_ros.printable import printable
from ator_ros.refinement.free_variables import allowed_changes, same_value
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import InvalidChainError, TopCall, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.objects import at_object, at_rest, followed, has_left, is_at_front
from ator_ros.world.state import ObjectState, World

AGAIN_AFTER = 0.15
"""Deviation in m of an object or the robot after which refinement is asked again."""
_NOT_ASKED = "executed as sent; the goal has refine: false"
_NOT_REACHED = "refinement not requested yet"
_UNANSWERED = "no answer from refinement yet"
_LONGEST = 120  # characters of the result of one question: the sentence on all stays readable

Continuation = tuple[int, TopChain]
"""Number of a plan among those of the goal, from 0, and its steps that are not done."""


@dataclass(frozen=True, slots=True)
class Question:
    """A question to refinement.

    Attributes
    ----------
    world : World
        The state from which the chain would continue.
    chain : TopChain
        The steps that are not done.
    step : int
        Index of the first of them in the goal's chain, from 0.
    asked : float
        Real time of the question in s.
    others : tuple of Continuation
        How other plans of the goal would continue from there; refinement may choose one of them.
    cause : str
        What has changed since the question before, in words; empty for the first question.
    """

    world: World
    chain: TopChain
    step: int
    asked: float
    others: tuple[Continuation, ...] = ()
    cause: str = ""


class Refining:
    """The questions of one goal to refinement, one at a time, and what the answers change.

    Attributes
    ----------
    wanted : bool
        Whether the goal asks for refinement.
    refined : bool
        Whether an answer changed the chain.
    refined_again : int
        Number of changes after the chain's start.

    Parameters
    ----------
    plans : sequence of TopChain
        The chains of the goal, of which an answer may choose any.
    again_after : float
        Distance in m by which an object or the robot must differ from the last question before refinement is
        asked again; 0: never again.
    """

    def __init__(
        self,
        executor: ChainExecutor,
        library: TopLibrary,
        plans: Sequence[TopChain],
        *,
        wanted: bool,
        again_after: float = AGAIN_AFTER,
    ) -> None:
        self.question: Question | None = None
        self.wanted, self.refined, self.refined_again = wanted, False, 0
        self._executor, self._library, self._robot = executor, library, library.robot
        self._plans, self._number = plans, 0
        self._again_after = again_after
        self._expected: Mapping[str, ObjectState] = {}  # objects in the world of the last question
        self._path: FloatArray | None = None  # that was planned then, or later for another step
        self._call: TopCall | None = None  # for which the path was planned
        self._answer: tuple[TopChain, str, int] | None = None
        self._first: str | None = None  # result of the first question
        self._changed = self._unchanged = ""  # results of the last question that changed the chain, and after

    @property
    def reason(self) -> str:
        """Results of the first question, of the last that changed the chain, and of the last since then."""
        if self._first is not None:
            return self._first + self._changed + self._unchanged
        if not self.wanted:
            return _NOT_ASKED
        return _NOT_REACHED if self.question is None else _UNANSWERED

    def ask(self, world: World, now: float) -> None:
        """Ask about the whole chain, before it starts."""
        self._expected = world.objects
        self.question = Question(world, self._executor.chain, 0, now)

    def ask_again(self, world: World, now: float) -> None:
        """Ask about the remaining steps and the other plans if the world deviates from the last question."""
        if not (self.wanted and self._again_after) or self.question is not None:
            return
        resting, step = at_rest(world, self._robot), self._executor.index
        cause = self._deviation(world, resting)
        if not cause:
            return
        chain = with_followed(self._executor.chain, resting, self._robot, step=step)
        others = continuations(self._plans, self._number, chain, step, resting, self._robot)
        self._expected, self._call = resting.objects, None
        self.question = Question(resting, TopChain(chain.calls[step:]), step, now, others, cause)

    def _deviation(self, world: World, resting: World) -> str:
        """Return what deviates by more than `again_after` from the last question; empty if nothing does.

        Objects, but those that the robot itself moves, are compared where they come to rest, the robot with
        the planned path of the active action.
        """
        executor, most = self._executor, self._again_after
        for _, name in awaited(executor.chain.calls[executor.index :]):
            there, expected = resting.objects.get(name), self._expected.get(name)
            if there is None or is_at_front(world, self._robot, name):
                continue
            if expected is None:
                return f"the {name} was not known"
            moved = math.hypot(there.x - expected.x, there.y - expected.y)
            if moved > most:
                return f"the {name} comes to rest {moved:.2f} m from the forecast"
        if self._path is None or executor.call is not self._call:
            self._path, self._call = executor.path(), executor.call
        off = 0.0 if self._path is None else _distance(world.robot.pose, self._path)
        return f"the robot is {off:.2f} m off its path" if off > most else ""

    def take(self, chain: TopChain, refined: bool, reason: str, chosen: int) -> None:
        """Accept the answer to `question`; while the robot drives, `apply` applies it in the next tick.

        The parameters are those of `Supervisor.refined_to`.
        """
        assert self.question is not None
        choices = len(self._plans) if self._first is None else 1 + len(self.question.others)
        if chosen >= choices:
            self.refuse(f"chosen: expected an index from 0 to {choices - 1}, got {chosen}")
        elif self._first is None:
            self._start_with(self.question, chain, refined, reason, chosen)
        elif refined or chosen:
            self._answer = chain, reason, chosen
        else:  # the chain being executed has no placeholders left
            self._close(reason, changed=False)

    def _start_with(
        self, question: Question, chain: TopChain, refined: bool, reason: str, chosen: int
    ) -> None:
        planned = self._plans[chosen]
        asked = dataclasses.replace(question, chain=planned)
        try:
            executed = refined_chain(planned, asked, chain, question.world, self._library)
        except InvalidChainError as error:
            self.refuse(f"the answer cannot be used: {error}")
            return
        self._executor.choose(executed)
        self._choose(chosen, reason, changed=refined and executed != planned)

    def refuse(self, why: str) -> None:
        """Go on with the chain as it is because `question` has no valid answer."""
        if self._first is None:
            self._number = self._plans.index(self._executor.chain)
            why = f"executed as sent, refinement failed: {why}"
        self._close(why, changed=False)

    def revert(self, why: str) -> bool:
        """Begin with the chain as sent if the first action of the refined one failed where it began.

        Returns whether it begins again; `why` is the failure.
        """
        if not self.refined or not self._executor.fall_back_to(self._plans[self._number]):
            return False
        self.refined, self.refined_again = False, 0
        self._first = f"executed as sent, as the refined chain failed at its start: {why}"
        self._changed = self._unchanged = ""
        return True

    def apply(self, world: World) -> bool:
        """Switch to the refined goals of an answer, if they can still be used; return whether it did."""
        answer, question, self._answer = self._answer, self.question, None
        if answer is None or question is None:
            return False
        refined, reason, chosen = answer
        obstacle = self._switch(question, refined, chosen, world)
        if obstacle:
            self.refuse(obstacle)
            return False
        self._choose(question.others[chosen - 1][0] if chosen else self._number, reason, changed=True)
        return True

    def _switch(self, question: Question, refined: TopChain, chosen: int, world: World) -> str:
        """Switch to the refined goals; return why that is impossible, or an empty text."""
        chain, step = self._executor.chain, question.step
        if step != self._executor.index:
            return "the step was over when the answer came"
        if chosen:
            _, rest = question.others[chosen - 1]
            chain = TopChain((*chain.calls[:step], *rest.calls))
            question = dataclasses.replace(question, chain=rest)
        resting = at_rest(world, self._robot)
        chain = with_followed(chain, resting, self._robot, step=step)
        try:
            changed = refined_chain(chain, question, refined, resting, self._library)
        except InvalidChainError as error:
            return f"the answer cannot be used: {error}"
        if not self._executor.switch_to(world, changed):
            return "no path leads from here to the refined subgoal"
        return ""

    def _choose(self, number: int, reason: str, *, changed: bool) -> None:
        other, self._number = number != self._number, number
        self._close(f"alternative {number} is chosen: {reason}" if other else reason, changed=changed)

    def _close(self, why: str, *, changed: bool) -> None:
        """Close the question with the reason for its result."""
        cause = "" if self.question is None else self.question.cause
        self.question, why = None, why or "no reason given"
        self.refined = self.refined or changed
        if self._first is None:
            self._first = why
            return
        after = f"after {self._executor.elapsed:.2f} s, as {cause}: {printable(why, _LONGEST)}"
        if changed:
            self.refined_again += 1
            self._changed, self._unchanged = f"; refined again {after}", ""
        else:
            self._unchanged = f"; asked again {after}"


def _distance(pose: Pose, path: FloatArray) -> float:
    """Return the distance in m from a pose to the polygon through the positions of a path."""
    points = path[:, :2] - (pose.x, pose.y)
    begins, along = points[:-1], np.diff(points, axis=0)
    squares = np.maximum((along**2).sum(axis=1), 1e-12)
    shares = np.clip(-(begins * along).sum(axis=1) / squares, 0.0, 1.0)
    nearest = np.vstack([points[-1:], begins + shares[:, None] * along])
    return float(np.hypot(nearest[:, 0], nearest[:, 1]).min())


def awaited(calls: Sequence[TopCall]) -> Iterator[tuple[int, str]]:
    """Yield index (from 0) and object of each step that follows an object which no earlier step moves."""
    moved: set[str] = set()
    for index, call in enumerate(calls):
        name = followed(call.top)
        if name is not None and name not in moved:
            yield index, name
        moved |= call.top.post.objects()


def with_followed(chain: TopChain, resting: World, robot: Robot, *, step: int = 0) -> TopChain:
    """Return `chain` with the goals from `step` on (from 0) where the objects lie that have left them.

    `resting` is the state, with its objects at rest.
    """
    for index, name in awaited(chain.calls[step:]):
        call = chain.calls[step + index]
        if has_left(resting, call, robot):
            chain = chain.with_goal(step + index, at_object(call.goal, resting, name))
    return chain


def continuations(
    plans: Sequence[TopChain], number: int, chain: TopChain, step: int, resting: World, robot: Robot
) -> tuple[Continuation, ...]:
    """Return how other plans go on from here: after the steps that they share with what is done, or from 0.

    `chain` is executed, as plan `number` (from 0); `step` is its first step that is not done. What is no
    valid plan from the state `resting`, whose objects are at rest, is left out.
    """
    found = []
    done = chain.calls[:step]
    for other, plan in enumerate(plans):
        if other == number:
            continue
        shared = 0 < len(done) < len(plan) and all(map(_same, done, plan.calls))
        for rest in ([TopChain(plan.calls[len(done) :])] if shared else []) + [plan]:
            moved = with_followed(rest, resting, robot)
            if not moved.violations(resting, robot):
                found.append((other, moved))
                break
    return tuple(found)


def _same(done: TopCall, planned: TopCall) -> bool:
    """Return whether a step that is done has the TOP and all bound goal variables of a planned one."""
    there = goal_values(done.goal)
    return done.top == planned.top and all(
        name in there and same_value(name, there[name], value)
        for name, value in goal_values(planned.goal).items()
        if not planned.opens(name) and not (name in ("x", "y") and followed(planned.top))
    )


def refined_chain(
    chain: TopChain, question: Question, answer: TopChain, world: World, library: TopLibrary
) -> TopChain:
    """Return `chain` with the changes that `answer` makes to the chain of `question`.

    All other goals stay as they are in `chain`: they may have moved with an object since the question.

    Raises
    ------
    InvalidChainError
        The answer changes what it may not, or what results is no valid plan from `world`.
    """
    changes = allowed_changes(question.chain, answer, library.robot, library.ranges)
    rest = [
        dataclasses.replace(call, goal=with_values(call.goal, values)) if values else call
        for call, values in zip(chain.calls[question.step :], changes, strict=True)
    ]
    violations = TopChain(tuple(rest)).violations(world, library.robot)
    if violations:
        raise InvalidChainError(f"no valid plan: {violations[0]}")
    return TopChain((*chain.calls[: question.step], *rest))
