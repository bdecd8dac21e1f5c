"""What a goal asks of refinement, before its chain starts and again when the ball has moved (without ROS)."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

from ator_ros.refinement.changes import allowed_changes
from ator_ros.refinement.free_variables import with_values
from ator_ros.robot.description import Robot
from ator_ros.tops.ball import at_rest, drives_to_ball, is_at_front
from ator_ros.tops.chain import InvalidChainError, TopChain
from ator_ros.world.state import BallState, World

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
        Number of the first of them, from 0.
    asked : float
        Real time in s.
    """

    world: World
    chain: TopChain
    step: int
    asked: float


class Refining:
    """The questions of one goal, one at a time, and the sentence on what became of them.

    Attributes
    ----------
    question : Question or None
        The one that is open.
    refined : bool
        Whether the chain was changed.
    again : int
        How many times it was changed after its start.

    Parameters
    ----------
    robot : Robot
        Sizes, and how the ball rolls.
    wanted : bool
        Whether the goal asks for refinement at all.
    again_after : float
        Distance in m by which the ball must have moved to ask again; 0: never.
    """

    def __init__(self, robot: Robot, *, wanted: bool, again_after: float) -> None:
        self.wanted = wanted
        self.question: Question | None = None
        self.refined = False
        self.again = 0
        self._robot, self._again_after = robot, again_after
        self._known: BallState | None = None
        self._first: str | None = None
        self._changed = self._left = ""

    @property
    def reason(self) -> str:
        """What became of the first question, of the last that changed the chain, and of one since then."""
        unanswered = _UNANSWERED if self.wanted else _NOT_ASKED
        return (self._first or unanswered) + self._changed + self._left

    def ask(self, world: World, chain: TopChain, now: float, *, step: int = 0) -> None:
        """Ask about `chain` from `step` on."""
        self._known = at_rest(world, self._robot).ball
        self.question = Question(world, TopChain(chain.calls[step:]), step, now)

    def ask_again(self, world: World, chain: TopChain, now: float, *, step: int) -> None:
        """Ask when the ball that is approached lies elsewhere than it did for the question before."""
        if not (self.wanted and self._again_after) or self.question is not None:
            return
        if not drives_to_ball(chain.calls[step].top) or is_at_front(world, self._robot):
            return
        resting = at_rest(world, self._robot)  # where the goals of approaches follow the ball
        ball, known = resting.ball, self._known
        if ball is None:
            return
        if known is None or math.hypot(ball.x - known.x, ball.y - known.y) > self._again_after:
            self.ask(resting, chain, now, step=step)

    def close(self, why: str, *, changed: bool, elapsed: float) -> None:
        """Note why the chain that was asked about was changed or left alone, `elapsed` s after its start."""
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
    chain: TopChain, question: Question, answer: TopChain, world: World, robot: Robot
) -> TopChain:
    """Return `chain` with what `answer` changes of the chain in question.

    The rest stays as it is now: a ball that is driven to may have moved on since the question.

    Raises
    ------
    InvalidChainError
        The answer changes what it may not, or what results is no valid plan from `world`.
    """
    changes = allowed_changes(question.chain, answer, robot)
    rest = [
        dataclasses.replace(call, goal=with_values(call.goal, values)) if values else call
        for call, values in zip(chain.calls[question.step :], changes, strict=True)
    ]
    violations = TopChain(tuple(rest)).violations(world, robot)
    if violations:
        raise InvalidChainError(f"no valid plan: {'; '.join(violations)}")
    return TopChain((*chain.calls[: question.step], *rest))
