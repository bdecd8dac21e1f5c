"""The questions of a goal to refinement: before its chain starts, and again when the world has changed."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from ator_ros.actions.goal_variables import with_values
from ator_ros.execution.remaining import Continuation
from ator_ros.execution.told_world import ToldWorld, Way
from ator_ros.printable import printable
from ator_ros.refinement.free_variables import allowed_changes
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import InvalidChainError, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import World

AGAIN_AFTER = 0.15
"""Distance in m by which the world must differ from what was expected before refinement is asked again."""
_NOT_ASKED = "executed as sent; the goal has refine: false"
_NOT_REACHED = "refinement not requested yet"
_UNANSWERED = "no answer from refinement yet"
_LONGEST = 120
"""Characters of the result of a question along the way: the sentence on all questions stays readable."""


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
        Distance in m by which an object or the robot must differ from the last question before refinement is
        asked again; 0: never again.
    """

    def __init__(self, robot: Robot, *, wanted: bool, again_after: float) -> None:
        self.wanted = wanted
        self.question: Question | None = None
        self.refined = False
        self.again = 0
        self._again_after = again_after
        self._told_world = ToldWorld(robot)
        self._first: str | None = None
        self._changed = self._left = ""

    @property
    def reason(self) -> str:
        """Results of the first question, of the last that changed the chain, and of the last since then."""
        return (self._first or self._no_result()) + self._changed + self._left

    def _no_result(self) -> str:
        """Return why there is no result of the first question."""
        if not self.wanted:
            return _NOT_ASKED
        return _NOT_REACHED if self.question is None else _UNANSWERED

    def ask(
        self,
        world: World,
        chain: TopChain,
        now: float,
        *,
        step: int = 0,
        others: tuple[Continuation, ...] = (),
        cause: str = "",
    ) -> None:
        """Ask about `chain` from `step` on."""
        self._told_world.told(world)
        self.question = Question(world, TopChain(chain.calls[step:]), step, now, others, cause)

    def cause(self, world: World, chain: TopChain, step: int, way: Way) -> str:
        """Return in words why to ask again, see `ToldWorld.beyond`; empty where there is no reason to."""
        if not (self.wanted and self._again_after) or self.question is not None:
            return ""
        return self._told_world.beyond(self._again_after, world, chain, step, way)

    def close(self, why: str, *, changed: bool, elapsed: float) -> None:
        """Close the question, `elapsed` s after the chain's start, with the reason for its result."""
        cause = "" if self.question is None else self.question.cause
        self.question, why = None, why or "no reason given"
        self.refined = self.refined or changed
        if self._first is None:
            self._first = why
            return
        why = printable(why, _LONGEST)
        if changed:
            self.again += 1
            self._changed, self._left = f"; refined again after {elapsed:.2f} s, as {cause}: {why}", ""
        else:
            self._left = f"; asked again after {elapsed:.2f} s, as {cause}: {why}"

    def take_back(self, why: str) -> None:
        """Forget all changes: the chain begins anew as it was sent, for the reason `why`."""
        self.refined, self.again, self._first = False, 0, why
        self._changed = self._left = ""


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
        more = f" (and {len(violations) - 1} more)" if len(violations) > 1 else ""
        raise InvalidChainError(f"no valid plan: {violations[0]}{more}")
    return TopChain((*chain.calls[: question.step], *rest))
