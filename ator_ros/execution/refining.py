"""Refinement of a goal's chain: before it starts, and again when the world has changed."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from ator_ros.actions.goal_variables import goal_values, with_values
from ator_ros.bases.description import Robot
from ator_ros.execution.chain_executor import ChainExecutor
from ator_ros.execution.fence import Fence
from ator_ros.geometry import FloatArray, Pose
from ator_ros.printable import printable
from ator_ros.refinement.free_variables import allowed_changes, same_value
from ator_ros.refinement.naive import naive_on_paths
from ator_ros.refinement.refiner import LONGEST_ALTERNATIVE
from ator_ros.tops.chain import InvalidChainError, TopCall, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.objects import at_object, at_rest, followed, has_left, is_at_front
from ator_ros.tops.ordering import in_valid_order, ordering_of
from ator_ros.world.state import ObjectState, World

AGAIN_AFTER = 0.15
"""Deviation in m of an object or the robot above which refinement is asked again."""
_NOT_ASKED = "executed as sent; the goal has refine: false"
_NOT_REACHED = "refinement not requested yet"
_UNANSWERED = "no answer from refinement yet"
_LONGEST = 120  # characters of the result of one question, so that the sentence on all is readable

Continuation = tuple[int, TopChain]
"""Index of a plan of the goal, from 0, and its steps that are not done."""


@dataclass(frozen=True, slots=True)
class Question:
    """A question to refinement, which may choose one of `others`: parts of other plans."""

    world: World  # the state from which the chain would continue
    chain: TopChain  # the steps that are not done
    step: int  # index of the first of them in the goal's chain, from 0
    asked: float  # s; real time of the question
    others: tuple[Continuation, ...] = ()
    cause: str = ""  # the change since the question before, in words; empty for the first question


@dataclass(frozen=True, slots=True)
class Answer:
    """An answer of refinement to a `Question`, or why there is none.

    Attributes
    ----------
    chain : TopChain or None
        The chain to execute, None if there is none. An unrefined one may differ from the question:
        naive values replace placeholders.
    refined : bool
        Whether goals were changed.
    reason : str
        A sentence on the result.
    chosen : int
        Index of the chain: 0 is that of the question, others are its alternatives.
    """

    chain: TopChain | None
    refined: bool
    reason: str
    chosen: int = 0


class Refining:
    """The questions of one goal to refinement, one at a time, and the effect of the answers.

    Attributes
    ----------
    refined : bool
        Whether an answer changed the chain.
    refined_again : int
        Number of changes after the chain's start.

    Parameters
    ----------
    plans : sequence of TopChain
        The chains of the goal, of which an answer may choose any.
    wanted : bool
        Whether the goal asks for refinement; then values of open variables are placeholders.
    fence : Fence
        The area that naive goals must not leave.
    again_after : float
        Deviation in m of an object or the robot from the last question above which refinement is
        asked again; 0: never again.
    """

    def __init__(
        self,
        executor: ChainExecutor,
        library: TopLibrary,
        plans: Sequence[TopChain],
        *,
        wanted: bool,
        fence: Fence,
        again_after: float = AGAIN_AFTER,
    ) -> None:
        self.question: Question | None = None
        self.wanted = wanted
        self.refined = False
        self.refined_again = 0
        self._executor = executor
        self._library = library
        self._robot = library.robot
        self._plans = plans
        self._number = 0
        self._started = 0  # the plan that is executed if there is no answer
        self._fence = fence
        self._again_after = again_after
        self._expected: Mapping[str, ObjectState] = {}  # objects in the world of the last question
        # planned at the last question, or later for another step
        self._path: FloatArray | None = None
        self._call: TopCall | None = None  # the step of that path
        self._answer: Answer | None = None  # until it is applied
        self._first: str | None = None  # result of the first question
        # results of the last question that changed the chain, and after
        self._changed = self._unchanged = ""

    @property
    def reason(self) -> str:
        """Results of the first question, the last that changed the chain, and the last."""
        if self._first is not None:
            return self._first + self._changed + self._unchanged
        if not self.wanted:
            return _NOT_ASKED
        return _NOT_REACHED if self.question is None else _UNANSWERED

    def valid(self, plan: TopChain, world: World) -> TopChain:
        """Return a plan in an order in which it is valid from `world`: as sent if possible.

        Only refinement may choose another order. Raises InvalidChainError if there is none.
        """
        if self.wanted:
            return in_valid_order(plan, world, self._robot)
        if violations := plan.violations(world, self._robot):
            raise InvalidChainError("; ".join(violations))
        return plan

    def start_with(self, number: int, chain: TopChain) -> None:
        """Execute plan `number` (from 0), in its valid order, unless refinement changes it."""
        self._started = number
        self._executor.choose(chain)

    def ask(self, world: World, now: float) -> None:
        """Ask about the whole chain, before it starts."""
        self._expected = world.objects
        self.question = Question(world, self._executor.chain, 0, now)

    def ask_again(self, world: World, now: float) -> None:
        """Ask about the rest and the other plans if the world deviates from the last question."""
        if not (self.wanted and self._again_after) or self.question is not None:
            return
        resting = at_rest(world, self._robot)
        step = self._executor.index
        cause = self._deviation(world, resting)
        if not cause:
            return
        chain = with_followed(self._executor.chain, resting, self._robot, step=step)
        others = continuations(self._plans, self._number, chain, step, resting, self._robot)
        self._expected = resting.objects
        self._call = None
        self.question = Question(resting, chain.part(step), step, now, others, cause)

    def _deviation(self, world: World, resting: World) -> str:
        """Return which deviation from the last question exceeds `again_after`; empty if none does.

        Objects, except those that the robot moves, are compared where they come to rest, the robot
        with the planned path of the active action.
        """
        executor = self._executor
        most = self._again_after
        for _, name in awaited(executor.chain.calls[executor.index :]):
            actual = resting.objects.get(name)
            expected = self._expected.get(name)
            if actual is None or is_at_front(world, self._robot, name):
                continue
            if expected is None:
                return f"the {name} was not known"
            moved = math.hypot(actual.x - expected.x, actual.y - expected.y)
            if moved > most:
                return f"the {name} comes to rest {moved:.2f} m from the forecast"
        if self._path is None or executor.call is not self._call:
            self._path = executor.path()
            self._call = executor.call
        off = 0.0 if self._path is None else _distance(world.robot.pose, self._path)
        return f"the robot is {off:.2f} m off its path" if off > most else ""

    def answer(self, answer: Answer) -> None:
        """Process the answer to `question`: before the chain starts at once, later by `apply`."""
        assert self.question is not None
        choices = len(self._plans) if self._first is None else 1 + len(self.question.others)
        if answer.chain is None:
            self._refuse(answer.reason)
        elif answer.chosen >= choices:
            self._refuse(f"chosen: expected an index from 0 to {choices - 1}, got {answer.chosen}")
        elif self._first is None:
            self._start(self.question, answer.chain, answer)
        elif answer.refined or answer.chosen:
            self._answer = answer
        else:  # the chain being executed has no placeholders left
            self._close(answer.reason, changed=False)

    def _start(self, question: Question, refined: TopChain, answer: Answer) -> None:
        planned = self._plans[answer.chosen]
        asked = dataclasses.replace(question, chain=planned)
        try:
            executed = refined_chain(planned, asked, refined, question.world, self._library)
        except InvalidChainError as error:
            self._refuse(f"the answer cannot be used: {error}")
            return
        self._executor.choose(executed)
        self._choose(answer.chosen, answer, changed=answer.refined and executed != planned)

    def _refuse(self, why: str) -> None:
        """Continue with the naive chain, or the one in execution: there is no valid answer."""
        if self._first is None and self.question is not None:
            self._number = self._started
            naive = self._naive(self.question.world)
            self._executor.choose(naive)
            why = f"{_executed(self._plans[self._number], naive)}, refinement failed: {why}"
        self._close(why, changed=False)

    def revert(self, world: World, why: str) -> bool:
        """Start again with the naive chain if its first action failed before the robot moved.

        Returns whether it starts again; `why` is the failure.
        """
        if not self.refined:
            return False
        naive = self._naive(world)
        if not self._executor.fall_back_to(naive):
            return False
        self.refined = False
        self.refined_again = 0
        how = _executed(self._plans[self._number], naive)
        self._first = f"{how}, as the refined chain failed at its start: {why}"
        self._changed = self._unchanged = ""
        return True

    def _naive(self, world: World) -> TopChain:
        """Return the chosen plan with naive values; with those sent if these leave the fence."""
        sent = self._plans[self._number]
        with suppress(InvalidChainError):
            sent = self.valid(sent, world)
        naive = naive_on_paths(world, sent, self._robot, self._library.ranges)
        return sent if self._fence.violation(naive, self._robot) else naive

    def apply(self, world: World) -> bool:
        """Switch to the refined goals of an answer if they are still valid.

        Return whether it did.
        """
        answer = self._answer
        question = self.question
        self._answer = None
        if answer is None or answer.chain is None or question is None:
            return False
        obstacle = self._switch(question, answer.chain, answer.chosen, world)
        if obstacle:
            self._refuse(obstacle)
            return False
        others = [self._number, *(number for number, _ in question.others)]
        self._choose(others[answer.chosen], answer, changed=True)
        return True

    def _switch(self, question: Question, refined: TopChain, chosen: int, world: World) -> str:
        """Switch to the refined goals; return why that is impossible, or an empty text."""
        chain = self._executor.chain
        step = question.step
        if step != self._executor.index:
            return "the step was over when the answer came"
        if chosen:
            _, rest = question.others[chosen - 1]
            chain = TopChain((*chain.part(0, step).calls, *rest.calls))
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

    def _choose(self, number: int, answer: Answer, *, changed: bool) -> None:
        other = number != self._number
        reason = answer.reason
        self._number = number
        self._close(
            f"alternative {number} is chosen: {reason}" if other else reason, changed=changed
        )

    def _close(self, why: str, *, changed: bool) -> None:
        """Close the question with the reason for its result."""
        cause = "" if self.question is None else self.question.cause
        self.question = None
        why = why or "no reason given"
        self.refined = self.refined or changed
        if self._first is None:
            self._first = why
            return
        after = f"after {self._executor.elapsed:.2f} s, as {cause}: {printable(why, _LONGEST)}"
        if changed:
            self.refined_again += 1
            self._changed = f"; refined again {after}"
            self._unchanged = ""
        else:
            self._unchanged = f"; asked again {after}"


def _executed(sent: TopChain, executed: TopChain) -> str:
    """Return in words with which values a chain is executed without refinement."""
    if executed == sent:
        return "executed as sent"
    order = "" if executed.order == sent.order else ", in a valid order"
    return f"executed with naive values{order}"


def _distance(pose: Pose, path: FloatArray) -> float:
    """Return the distance in m from a pose to the polygon through the positions of a path."""
    points = path[:, :2] - (pose.x, pose.y)
    begins = points[:-1]
    along = np.diff(points, axis=0)
    squares = np.maximum((along**2).sum(axis=1), 1e-12)
    shares = np.clip(-(begins * along).sum(axis=1) / squares, 0.0, 1.0)
    nearest = np.vstack([points[-1:], begins + shares[:, None] * along])
    return float(np.hypot(nearest[:, 0], nearest[:, 1]).min())


def awaited(calls: Sequence[TopCall]) -> Iterator[tuple[int, str]]:
    """Yield index (from 0) and object of the steps that follow one which none moves before."""
    moved: set[str] = set()
    for index, call in enumerate(calls):
        name = followed(call.top)
        if name is not None and name not in moved:
            yield index, name
        moved |= call.top.post.objects()


def with_followed(chain: TopChain, resting: World, robot: Robot, *, step: int = 0) -> TopChain:
    """Return `chain` with the goals from `step` (from 0) moved to the objects that have left them.

    `resting` is the state with its objects at rest.
    """
    for index, name in awaited(chain.calls[step:]):
        call = chain.calls[step + index]
        if has_left(resting, call, robot):
            chain = chain.with_goal(step + index, at_object(call.goal, resting, name))
    return chain


def continuations(
    plans: Sequence[TopChain], number: int, chain: TopChain, step: int, resting: World, robot: Robot
) -> tuple[Continuation, ...]:
    """Return the valid continuations of other plans: after the steps done, or from the start.

    Those too long for an alternative of a request are left out.

    `chain` is executed as plan `number` (from 0); `step` is its first step that is not done.
    `resting` is the state with its objects at rest.
    """
    found = []
    done = chain.calls[:step]
    for other, plan in enumerate(plans):
        if other == number:
            continue
        shared = 0 < len(done) < len(plan) and all(map(_same, done, plan.calls))
        for rest in ([plan.part(len(done))] if shared else []) + [plan.part(0)]:
            moved = with_followed(rest, resting, robot)
            if len(moved) <= LONGEST_ALTERNATIVE and not moved.violations(resting, robot):
                found.append((other, moved))
                break
    return tuple(found)


def _same(done: TopCall, planned: TopCall) -> bool:
    """Return whether a step that is done has TOP and bound variables of a planned one."""
    values = goal_values(done.goal)
    return done.top == planned.top and all(
        name in values and same_value(name, values[name], value)
        for name, value in goal_values(planned.goal).items()
        if not planned.opens(name) and not (name in ("x", "y") and followed(planned.top))
    )


def refined_chain(
    chain: TopChain, question: Question, answer: TopChain, world: World, library: TopLibrary
) -> TopChain:
    """Return `chain`, whose goals may have moved, with the changes made by `answer`.

    The order changes before the first step only.

    Raises
    ------
    InvalidChainError
        A change is not allowed, or the result is no valid plan from `world`.
    """
    planned = question.chain
    if answer.sent_as:
        if fault := ordering_of(planned).fault(answer.sent_as):
            raise InvalidChainError(f"order: {fault}")
        planned = planned.reordered(answer.sent_as)
        chain = chain.reordered(answer.sent_as)
    changes = allowed_changes(planned, answer, library.robot, library.ranges)
    rest = [
        dataclasses.replace(call, goal=with_values(call.goal, values)) if values else call
        for call, values in zip(chain.calls[question.step :], changes, strict=True)
    ]
    result = dataclasses.replace(chain, calls=(*chain.calls[: question.step], *rest))
    violations = result.part(question.step).violations(world, library.robot)
    if violations:
        raise InvalidChainError(f"no valid plan: {violations[0]}")
    return result
