"""The execution of one goal: wait, refine, execute, stop. Both clocks are passed in."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

from ator_ros.actions.base import Status
from ator_ros.execution.chain_executor import ChainExecutor
from ator_ros.execution.fence import Fence, FenceWatch
from ator_ros.execution.phases import Deadlines, Ending, Phase
from ator_ros.execution.predictions import Predictor, remaining
from ator_ros.execution.refining import Question, Refining, refined_chain
from ator_ros.execution.step_run import ActionRecord, is_standing
from ator_ros.refinement.chain_model import ChainPrediction
from ator_ros.tops.chain import InvalidChainError, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.objects import at_rest, missing_in, missing_object, objects_in
from ator_ros.tops.top import Top
from ator_ros.world.state import STOP, Command, World

_LONGEST_STOP = 2.0
_ENDINGS = {Status.SUCCEEDED: Ending.SUCCEEDED, Status.FAILED: Ending.FAILED}


class Execution:
    """One goal, from its acceptance until the robot stands again.

    Parameters
    ----------
    library : TopLibrary
        TOPs and actions.
    chain : TopChain
        The chain to execute.
    refining : Refining
        Questions to refinement; the chain starts after the first answer.
    now : float
        Real time in s, in all methods; states carry a time of their own.
    predictor, deadlines, fence
        Predictions of chains, times after which waiting ends, area in which the robot may drive.
    fetches : int
        Number of times that a lost object may be fetched again.
    """

    def __init__(
        self,
        library: TopLibrary,
        chain: TopChain,
        *,
        refining: Refining,
        now: float,
        predictor: Predictor,
        deadlines: Deadlines,
        fence: Fence,
        fetches: int = 0,
    ) -> None:
        self.chain = chain
        self.phase = Phase.WAITING
        self.ending: Ending | None = None
        self.reason = Phase.WAITING.value
        self.refining = refining
        self.start: World | None = None
        self.records: list[tuple[ActionRecord, World, Ending]] = []
        self.elapsed = 0.0
        self._library, self._predictor, self._deadlines = library, predictor, deadlines
        self._fence = FenceWatch(fence, library.robot, deadlines.longest_gap)
        self._fetches = fetches
        self._seen: World | None = None
        self._accepted, self._heard = now, math.inf
        self._stopped_at = math.inf
        self._blind: str | None = None
        self._executor: ChainExecutor | None = None
        self._answer: tuple[TopChain, str] | None = None
        self._prediction: Callable[[], ChainPrediction | None] | None = None

    @property
    def step(self) -> int:
        """Index of the step being executed, from 0."""
        return 0 if self._executor is None else self._executor.index

    @property
    def fetched(self) -> int:
        """Number of times that a lost object was fetched again."""
        return 0 if self._executor is None else self._executor.fetched

    @property
    def top(self) -> Top:
        """The TOP of the step being executed."""
        return self.chain.calls[self.step].top

    @property
    def predicted(self) -> ChainPrediction | None:
        """The prediction of the chain; computed on first use, so that it does not delay the first command."""
        return None if self._prediction is None else self._prediction()

    @property
    def question(self) -> Question | None:
        """The open question to refinement; None if there is none."""
        return self.refining.question if self.phase in (Phase.REFINING, Phase.EXECUTING) else None

    def predicted_remaining(self, now: float) -> float:
        """Return the predicted time in s from `now`, on odometry's clock, to the end; NaN if unknown."""
        if self.ending is not None:
            return 0.0
        if self.predicted is None or self.start is None:
            return math.nan
        began = self.records[-1][1].time if self.records else self.start.time
        return remaining(self.predicted, self.step, now - began)

    def silent(self, now: float) -> bool:
        """Return whether odometry has been missing for half its deadline, so that the robot should stand."""
        return self.phase is not Phase.ENDED and now - self._heard > self._deadlines.silence

    def tick(self, world: World, now: float, *, overdue: frozenset[str] = frozenset()) -> Command:
        """Process a newer state of the world and return the command for it.

        A step pauses while an object that it needs is overdue. The goal ends if that object is unknown in two
        states in a row, or when a step that needs it begins.
        """
        self._heard, self._seen = now, world
        # The first command, to stand, makes a simulation wait for the next one, which takes planning.
        if self.phase is Phase.WAITING and self._begin(world, now) and is_standing(world.robot):
            return STOP
        if self.phase is Phase.EXECUTING:
            return self._execute(world, now, overdue=overdue)
        if self.phase is Phase.STOPPING:
            self._stopped_at = min(self._stopped_at, world.time)
            stood = is_standing(world.robot) or world.time - self._stopped_at > _LONGEST_STOP
            self.phase = Phase.ENDED if stood else Phase.STOPPING
        return STOP

    def listening(self, now: float) -> None:
        """Restart the deadline of odometry at `now`: messages that came during a tick were not missing."""
        self._heard = now

    def watch(self, now: float) -> None:
        """Check all deadlines at `now`."""
        if self.phase is Phase.WAITING and now - self._accepted > self._deadlines.start:
            self._give_up_waiting()
        if self.question is not None and now - self.question.asked > self._deadlines.refinement:
            self.unrefined(f"no answer within {self._deadlines.refinement:g} s")
        if self.phase is not Phase.ENDED and now - self._heard > self._deadlines.odom:
            reason = f"odom is missing: expected newer odometry within {self._deadlines.odom:g} s, got none"
            self.end(Ending.INPUT_LOST, reason)
            self.phase = Phase.ENDED  # no state will show when the robot stands

    def end(self, ending: Ending, reason: str) -> None:
        """End the goal, once: later reasons are ignored. An action under way is recorded as broken off."""
        if self.ending is not None:
            return
        if self._executor is not None and self._seen is not None:
            self._executor.break_off(self._seen, reason)
            self._keep_records(self._executor, self._seen, ending)
        self.ending, self.reason, self.phase = ending, reason, Phase.STOPPING
        if math.isinf(self._heard):  # odometry never came: its deadline counts from the acceptance
            self._heard = self._accepted

    def misbehaved(self, reason: str) -> None:
        """End because the base does not follow its commands, even if only its standstill is awaited."""
        if self.ending is Ending.SUCCEEDED and self.phase is Phase.STOPPING:
            self.ending, self.reason = Ending.BASE_FAULT, reason
        self.end(Ending.BASE_FAULT, reason)

    def refined_to(self, chain: TopChain, refined: bool, reason: str) -> None:
        """Accept the answer to `question`; while the robot drives, the next tick applies it.

        An unrefined answer may differ from the question: naive values replace its placeholders.
        """
        if self.question is None:
            return
        if self._executor is None:
            self._start_with(chain, refined, reason)
        elif refined:
            self._answer = chain, reason
        else:  # the chain being executed has no placeholders left
            self._go_on(reason, changed=False)

    def unrefined(self, why: str) -> None:
        """Go on with the chain as it is because `question` has no valid answer."""
        sent = "" if self.phase is Phase.EXECUTING else "executed as sent, "
        self._go_on(f"{sent}refinement failed: {why}", changed=False)

    def _go_on(self, why: str, *, changed: bool) -> None:
        if self.question is not None:
            self.refining.close(why, changed=changed, elapsed=self.elapsed)
            self.phase = Phase.EXECUTING

    def _start_with(self, chain: TopChain, refined: bool, reason: str) -> None:
        assert self.start is not None
        assert self.question is not None
        planned = self.chain
        try:
            self.chain = refined_chain(planned, self.question, chain, self.start, self._library)
        except InvalidChainError as error:
            self.unrefined(f"its answer cannot be used: {error}")
        else:
            self._go_on(reason, changed=refined and self.chain != planned)

    def _take_answer(self, world: World, executor: ChainExecutor) -> None:
        """Switch to the refined goals from the present state, if that is still possible."""
        answer, question, self._answer = self._answer, self.question, None
        if answer is None or question is None:
            return
        if question.step != self.step:
            self.unrefined("its step was over when the answer came")
            return
        try:
            resting = at_rest(world, self._library.robot)
            changed = refined_chain(self.chain, question, answer[0], resting, self._library)
        except InvalidChainError as error:
            self.unrefined(f"its answer cannot be used: {error}")
            return
        if executor.head_for(world, changed):
            self._go_on(answer[1], changed=True)
        else:
            self.unrefined("there is no way from here to the refined subgoal")

    def _begin(self, world: World, now: float) -> bool:
        """Start once all objects that the chain needs are known; return whether it is executed now."""
        self.start = world
        missing = missing_in(self.chain.calls, world)
        if missing is not None:
            self.reason = f"waiting for the {missing[0]}"
            return False
        violations = self.chain.violations(world, self._library.robot)
        if violations:
            self.end(Ending.REFUSED, f"no valid plan: {'; '.join(violations)}")
            return False
        self.phase = Phase.REFINING if self.refining.wanted else Phase.EXECUTING
        if self.refining.wanted:
            self.refining.ask(world, self.chain, now)
        self.reason = self.phase.value
        return not self.refining.wanted

    def _give_up_waiting(self) -> None:
        limit = f"expected one within {self._deadlines.start:g} s of the goal, got none"
        if self.start is None:
            self.end(Ending.INPUT_LOST, f"odom is missing: {limit}")
            self.phase = Phase.ENDED  # no state will show when the robot stands
        else:
            name, top = missing_in(self.chain.calls, self.start) or ("", "")
            self.end(Ending.INPUT_LOST, f"{name} is missing: {top} needs it, {limit}")

    def _execute(self, world: World, now: float, *, overdue: frozenset[str]) -> Command:
        if self._executor is None:
            self.start = world  # later than the first state if refinement took time
            self._prediction = functools.cache(functools.partial(self._predictor.chain, world, self.chain))
            self._executor = ChainExecutor(
                self._library,
                self.chain,
                time_limit=self._deadlines.action,
                predict=lambda *step: functools.partial(self._predictor.action, *step),
                fetches=self._fetches,
            )
        blind, self._blind = self._blind, missing_object(self.top, world)
        # One state may lack an object: after a long tick odometry may be read before the object's message.
        if self._blind and blind:
            return self._end_without(self._blind)
        silent = self._blind or next((name for name in objects_in(self.top) if name in overdue), None)
        if silent:
            self.reason = f"{self.top.name} pauses: no word of the {silent}"
            return STOP
        fault = self._fence.fault(world, self.chain.calls[self.step])
        if fault is not None:
            return self._stop(Ending.OUT_OF_BOUNDS, fault)
        if self._fence.pausing:
            self.reason = f"{self.top.name} pauses: what it follows leads out of the fence"
            return STOP
        self._take_answer(world, self._executor)
        step = self._executor.step(world)
        self.chain = self._executor.chain
        self._keep_records(self._executor, world, Ending.PREEMPTED)
        self.elapsed = step.elapsed
        self.reason = step.message
        if step.status is Status.RUNNING:
            self.refining.ask_again(world, self.chain, now, step=self.step)
            return step.command
        missing = missing_object(self.top, world)  # of the step that has just begun
        if missing is not None:
            return self._end_without(missing)
        if step.status is Status.SUCCEEDED:
            return self._stop(Ending.SUCCEEDED, step.message)
        lost = self.records[-1][0].lost
        if lost is not None:
            return self._stop(Ending.OBJECT_LOST, f"{lost} lost in {self.top.name}: {step.message}")
        return self._stop(Ending.FAILED, step.message)

    def _keep_records(self, executor: ChainExecutor, world: World, broken_off: Ending) -> None:
        """Keep the records of the actions that ended in the state `world`."""
        new = executor.records[len(self.records) :]
        self.records += [(record, world, _ENDINGS.get(record.outcome, broken_off)) for record in new]

    def _end_without(self, name: str) -> Command:
        reason = f"{name} is missing: {self.top.name} needs it, and no recent one is known"
        return self._stop(Ending.INPUT_LOST, reason)

    def _stop(self, ending: Ending, reason: str) -> Command:
        self.end(ending, reason)
        return STOP
