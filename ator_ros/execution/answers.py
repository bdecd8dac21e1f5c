"""The answers of refinement to the questions of a goal, and what becomes of its chain."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from ator_ros.execution.chain_executor import ChainExecutor
from ator_ros.execution.phases import Phase
from ator_ros.execution.refining import Question, Refining, refined_chain
from ator_ros.execution.remaining import continuations, switched, with_followed
from ator_ros.execution.transitions import GoalCourse, Signal
from ator_ros.tops.chain import InvalidChainError, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.objects import at_rest
from ator_ros.world.state import World


class Answers:
    """Applies the answers of refinement to the chain of a goal.

    Parameters
    ----------
    refining : Refining
        The questions.
    executor : ChainExecutor
        Owns the chain.
    course : GoalCourse
        The goal's phase.
    library : TopLibrary
        The robot, and the ranges of goal variables.
    plans : sequence of TopChain
        The chains of the goal, of which an answer may choose any; the first is the question.
    """

    def __init__(
        self,
        refining: Refining,
        executor: ChainExecutor,
        course: GoalCourse,
        library: TopLibrary,
        plans: Sequence[TopChain],
    ) -> None:
        self._refining, self._executor, self._course, self._library = refining, executor, course, library
        self._plans, self._number = plans, 0
        self._answer: tuple[TopChain, str, int] | None = None

    @property
    def question(self) -> Question | None:
        """The open question to refinement; None if there is none."""
        asking = self._course.phase in (Phase.REFINING, Phase.EXECUTING)
        return self._refining.question if asking else None

    def take(self, chain: TopChain, refined: bool, reason: str, *, chosen: int = 0) -> None:
        """Accept the answer to `question`; while the robot drives, `apply` applies it in the next tick.

        An unrefined answer may differ from the question: naive values replace its placeholders.
        """
        question = self.question
        if question is None:
            return
        if self._course.phase is Phase.REFINING:
            self._start_with(question, chain, refined, reason, chosen)
        elif chosen > len(question.others):
            self._refuse_choice(chosen, 1 + len(question.others))
        elif refined or chosen:
            self._answer = chain, reason, chosen
        else:  # the chain being executed has no placeholders left
            self._go_on(reason, changed=False)

    def refuse(self, why: str) -> None:
        """Go on with the chain as it is because `question` has no valid answer."""
        if self._course.phase is Phase.REFINING:
            self._number = self._plans.index(self._executor.chain)
        along = self._course.phase is Phase.EXECUTING
        self._go_on(why if along else f"executed as sent, refinement failed: {why}", changed=False)

    def fall_back(self, why: str) -> bool:
        """Begin with the chain as sent if the first action of the refined one failed where it began."""
        if not self._refining.refined or not self._executor.begin_again(self._plans[self._number]):
            return False
        self._refining.take_back(f"executed as sent, as the refined chain failed at its start: {why}")
        return True

    def ask_again(self, world: World, now: float) -> None:
        """Ask about what remains, and about the other plans, if the world differs from what was told."""
        executor, robot = self._executor, self._library.robot
        cause = self._refining.cause(world, executor.chain, executor.index, executor.way)
        if not cause:
            return
        step, resting = executor.index, at_rest(world, robot)
        chain = with_followed(executor.chain, resting, robot, step=step)
        others = continuations(self._plans, self._number, chain, step, resting, robot)
        self._refining.ask(resting, chain, now, step=step, others=others, cause=cause)

    def apply(self, world: World) -> bool:
        """Switch to the refined goals if there are some and it is still possible; return whether it was."""
        answer, question, self._answer = self._answer, self.question, None
        if answer is None or question is None:
            return False
        refined, reason, chosen = answer
        obstacle = self._switch(question, refined, chosen, world)
        if obstacle:
            self.refuse(obstacle)
            return False
        if chosen:
            self._number = question.others[chosen - 1].number
            reason = f"alternative {self._number} is chosen: {reason}"
        self._go_on(reason, changed=True)
        return True

    def _switch(self, question: Question, refined: TopChain, chosen: int, world: World) -> str:
        """Switch to the refined goals; return why that is impossible, or an empty text."""
        if question.step != self._executor.index:
            return "the step was over when the answer came"
        try:
            changed = self._changed(question, refined, chosen, world)
        except InvalidChainError as error:
            return f"the answer cannot be used: {error}"
        if not self._executor.head_for(world, changed):
            return "there is no way from here to the refined subgoal"
        return ""

    def _changed(self, question: Question, refined: TopChain, chosen: int, world: World) -> TopChain:
        """Return the chain of the goal as an answer changes it; raises InvalidChainError."""
        chain, step, robot = self._executor.chain, question.step, self._library.robot
        if chosen:
            rest = question.others[chosen - 1].chain
            chain, question = switched(chain, step, rest), dataclasses.replace(question, chain=rest)
        resting = at_rest(world, robot)
        chain = with_followed(chain, resting, robot, step=step)
        return refined_chain(chain, question, refined, resting, self._library)

    def _start_with(
        self, question: Question, chain: TopChain, refined: bool, reason: str, chosen: int
    ) -> None:
        if chosen >= len(self._plans):
            self._refuse_choice(chosen, len(self._plans))
            return
        planned = self._plans[chosen]
        asked = dataclasses.replace(question, chain=planned)
        reason = f"alternative {chosen} is chosen: {reason}" if chosen else reason
        try:
            executed = refined_chain(planned, asked, chain, question.world, self._library)
        except InvalidChainError as error:
            self.refuse(f"the answer cannot be used: {error}")
            return
        self._executor.choose(executed)
        self._number = chosen
        self._go_on(reason, changed=refined and executed != planned)

    def _refuse_choice(self, chosen: int, of: int) -> None:
        self.refuse(f"chosen: expected an index from 0 to {of - 1}, got {chosen}")

    def _go_on(self, why: str, *, changed: bool) -> None:
        if self.question is not None:
            self._refining.close(why, changed=changed, elapsed=self._executor.elapsed)
            self._course.take(Signal.ANSWERED)
