"""The questions of a goal to refinement: before its chain starts, and again when an object has moved."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

from ator_ros.actions.goal_variables import with_values
from ator_ros.refinement.changes import allowed_changes
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import InvalidChainError, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.objects import at_rest, followed, is_at_front
from ator_ros.world.state import ObjectState, World

_NOT_ASKED = "refinement was not asked for"
_UNANSWERED = "no answer from refinement yet"


@dataclass(frozen=True, slots=True)
class Question:
    """A question to refinement.

    Attributes
    ----------
    world : World
        The state from which the chain would go on.
    chain : TopChain
        The steps that are not done.
    step : int
        Index of the first of them in the goal's chain, from 0.
    asked : float
        Real time of the question in s.
    """

    world: World
    chain: TopChain
    step: int
    asked: float


class Refining:
    """The questions of one goal, one at a time, and a sentence on their results.

    Attributes
    ----------
    question : Question or None
        The open question.
    refined : bool
        Whether an answer changed the chain.
    again : int
        Number of changes after the chain's start.

    Parameters
    ----------
    robot : Robot
        Its sizes, and the deceleration of rolling objects.
    wanted : bool
        Whether the goal asks for refinement.
    again_after : float
        Distance in m that an object must have moved before refinement is asked again; 0: never again.
    """

    def __init__(self, robot: Robot, *, wanted: bool, again_after: float) -> None:
        self.wanted = wanted
        self.question: Question | None = None
        self.refined = False
        self.again = 0
        self._robot, self._again_after = robot, again_after
        self._known: Mapping[str, ObjectState] = {}
        self._first: str | None = None
        self._changed = self._left = ""

    @property
    def reason(self) -> str:
        """Results of the first question, of the last that changed the chain, and of the last since then."""
        unanswered = _UNANSWERED if self.wanted else _NOT_ASKED
        return (self._first or unanswered) + self._changed + self._left

    def ask(self, world: World, chain: TopChain, now: float, *, step: int = 0) -> None:
        """Ask about `chain` from `step` on."""
        self._known = at_rest(world, self._robot).objects
        self.question = Question(world, TopChain(chain.calls[step:]), step, now)

    def ask_again(self, world: World, chain: TopChain, now: float, *, step: int) -> None:
        """Ask if the followed object has moved `again_after` since the last question."""
        if not (self.wanted and self._again_after) or self.question is not None:
            return
        name = followed(chain.calls[step].top)
        if name is None or is_at_front(world, self._robot, name):
            return
        resting = at_rest(world, self._robot)  # where the goals of approaches follow their objects
        there, known = resting.objects.get(name), self._known.get(name)
        if there is None:
            return
        if known is None or math.hypot(there.x - known.x, there.y - known.y) > self._again_after:
            self.ask(resting, chain, now, step=step)

    def close(self, why: str, *, changed: bool, elapsed: float) -> None:
        """Close the question, `elapsed` s after the chain's start, with the reason for its result."""
        self.question, why = None, why or "no reason given"
        self.refined = self.refined or changed
        if self._first is None:
            self._first = why
            return
        if changed:
            self.again += 1
            self._changed, self._left = f"; refined again after {elapsed:.2f} s: {why}", ""
        else:
            self._left = f"; asked again after {elapsed:.2f} s: {why}"


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
        raise InvalidChainError(f"no valid plan: {'; '.join(violations)}")
    return TopChain((*chain.calls[: question.step], *rest))
