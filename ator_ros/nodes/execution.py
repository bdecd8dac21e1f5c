"""The execution of one goal: refine, execute, stop (without ROS; both clocks are passed in)."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

from ator_ros.actions.base import Status
from ator_ros.nodes.phases import Deadlines, Ending, Phase
from ator_ros.nodes.predictions import Predictor
from ator_ros.nodes.refining import Question, Refining, refined_chain
from ator_ros.refinement.chain_model import ChainPrediction
from ator_ros.tops.ball import at_rest, needs_ball
from ator_ros.tops.chain import InvalidChainError, TopChain
from ator_ros.tops.executor import ChainExecutor
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.step_run import ActionRecord, is_standing
from ator_ros.tops.top import Top
from ator_ros.world import STOP, Command, World

_LONGEST_STOP = 2.0


class Execution:
    """One goal, from its acceptance until the robot stands again.

    Parameters
    ----------
    library : TopLibrary
        Gives the actions.
    chain : TopChain
        What to execute.
    refining : Refining
        What is asked of refinement; the start waits for the first answer.
    now : float
        The real time in s, as everywhere here: the state has a clock of its own.
    predictor : Predictor
        For predictions beside what happens.
    deadlines : Deadlines
        When to give up waiting.
    fetches : int
        How many times a lost ball may be fetched again.
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
        fetches: int = 0,
    ) -> None:
        self.chain = chain
        self.phase = Phase.WAITING
        self.ending: Ending | None = None
        self.reason = Phase.WAITING.value
        self.refining = refining
        self.start: World | None = None
        self.records: list[tuple[ActionRecord, World]] = []
        self.elapsed = 0.0
        self._library, self._predictor, self._deadlines = library, predictor, deadlines
        self._fetches = fetches
        self._accepted, self._heard = now, math.inf
        self._stopped_at = math.inf
        self._blind = False
        self._executor: ChainExecutor | None = None
        self._answer: tuple[TopChain, str] | None = None
        self._prediction: Callable[[], ChainPrediction | None] | None = None

    @property
    def step(self) -> int:
        """The step of the chain that is executed, from 0."""
        return 0 if self._executor is None else self._executor.index

    @property
    def fetched(self) -> int:
        """How many times a lost ball was fetched again."""
        return 0 if self._executor is None else self._executor.fetched

    @property
    def top(self) -> Top:
        """The TOP of that step."""
        return self.chain.calls[self.step].top

    @property
    def predicted(self) -> ChainPrediction | None:
        """What was predicted of the chain; computed when it is asked for, after the command is on its way."""
        return None if self._prediction is None else self._prediction()

    @property
    def question(self) -> Question | None:
        """What is to be asked of refinement now."""
        return self.refining.question if self.phase in (Phase.REFINING, Phase.EXECUTING) else None

    def predicted_remaining(self, now: float) -> float:
        """Give the predicted time in s from `now`, on the odometry's clock, to the end; NaN if not known."""
        if self.predicted is None or self.start is None:
            return math.nan
        began = self.records[-1][1].time if self.records else self.start.time
        current, *rest = (action.get("duration", math.nan) for action in self.predicted.actions[self.step :])
        return max(0.0, current - (now - began)) + sum(rest)

    # What happens

    def silent(self, now: float) -> bool:
        """Say whether no odometry has come for half its deadline: the robot should stand until it comes."""
        return self.phase is not Phase.ENDED and now - self._heard > self._deadlines.odom / 2.0

    def tick(self, world: World, now: float, *, ball_overdue: bool = False) -> Command:
        """Take a newer state of the world and give the command for it.

        Where the ball is overdue, a step that needs it pauses; it ends when twice in a row no recent ball is
        known, or when it is to begin without one.
        """
        self._heard = now
        # Planning takes time, for which a simulation waits that has heard from us.
        if self.phase is Phase.WAITING and self._begin(world, now) and is_standing(world.robot):
            return STOP
        if self.phase is Phase.EXECUTING:
            return self._execute(world, now, ball_overdue=ball_overdue)
        if self.phase is Phase.STOPPING:
            self._settle(world)
        return STOP

    def listening(self, now: float) -> None:
        """Listen again from `now` on: odometry that came while a tick was computed is not overdue."""
        self._heard = now

    def watch(self, now: float) -> None:
        """Look whether something is overdue."""
        if self.phase is Phase.WAITING and now - self._accepted > self._deadlines.start:
            self._give_up_waiting()
        if self.question is not None and now - self.question.asked > self._deadlines.refinement:
            self.unrefined(f"no answer within {self._deadlines.refinement:g} s")
        if self.phase is not Phase.ENDED and now - self._heard > self._deadlines.odom:
            reason = f"odom is missing: expected newer odometry within {self._deadlines.odom:g} s, got none"
            self.end(Ending.INPUT_LOST, reason)
            self.phase = Phase.ENDED  # nothing will tell when the robot stands

    def end(self, ending: Ending, reason: str) -> None:
        """End for a reason from outside, or from within; the first one counts."""
        if self.ending is not None:
            return
        self.ending, self.reason, self.phase = ending, reason, Phase.STOPPING
        if math.isinf(self._heard):  # then odometry that never came counts as missing since the acceptance
            self._heard = self._accepted

    def refined_to(self, chain: TopChain, refined: bool, reason: str) -> None:
        """Take the answer to `question`; when the robot drives, with the next state.

        A chain that was not refined may have had open variables: in the answer they are filled in.
        """
        if self.question is None:
            return
        if self._executor is None:
            self._start_with(chain, refined, reason)
        elif refined:
            self._answer = chain, reason
        else:  # the chain that is executed has nothing open
            self._go_on(reason, changed=False)

    def unrefined(self, why: str) -> None:
        """Go on with the chain as it is, since there is no good answer to `question`."""
        sent = "" if self.phase is Phase.EXECUTING else "executed as sent, "
        self._go_on(f"{sent}refinement failed: {why}", changed=False)

    def _go_on(self, why: str, *, changed: bool) -> None:
        if self.question is not None:
            self.refining.close(why, changed=changed, elapsed=self.elapsed)
            self.phase = Phase.EXECUTING

    def _start_with(self, chain: TopChain, refined: bool, reason: str) -> None:
        assert self.start is not None
        assert self.question is not None
        try:
            self.chain = refined_chain(self.chain, self.question, chain, self.start, self._library.robot)
        except InvalidChainError as error:
            self.unrefined(f"its answer cannot be used: {error}")
        else:
            self._go_on(reason, changed=refined)

    def _take_answer(self, world: World, executor: ChainExecutor) -> None:
        """Head for other goals from where the robot is, if that is still possible."""
        answer, question, robot, self._answer = self._answer, self.question, self._library.robot, None
        if answer is None or question is None:
            return
        chain, reason = answer
        if question.step != self.step:
            self.unrefined("its step was over when the answer came")
            return
        try:
            changed = refined_chain(self.chain, question, chain, at_rest(world, robot), robot)
        except InvalidChainError as error:
            self.unrefined(f"its answer cannot be used: {error}")
            return
        if executor.head_for(world, changed):
            self._go_on(reason, changed=True)
        else:
            self.unrefined("there is no way from here to the refined subgoal")

    # Phases

    def _begin(self, world: World, now: float) -> bool:
        """Start with the first state in which the chain can be judged: with a ball where one is needed.

        Says whether the chain is to be executed now.
        """
        self.start = world
        if world.ball is None and self._ball_user() is not None:
            self.reason = "waiting for a ball"
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
            self.phase = Phase.ENDED  # nothing will tell when the robot stands
        else:
            self.end(Ending.INPUT_LOST, f"ball is missing: {self._ball_user()} needs it, {limit}")

    def _ball_user(self) -> str | None:
        """Give the name of the chain's first TOP that needs the ball; None when none does."""
        return next((call.top.name for call in self.chain.calls if needs_ball(call.top)), None)

    def _execute(self, world: World, now: float, *, ball_overdue: bool) -> Command:
        if self._executor is None:
            # Later than the first state when refinement has taken its time.
            self.start = world
            self._prediction = functools.cache(functools.partial(self._predictor.chain, world, self.chain))
            self._executor = ChainExecutor(
                self._library,
                self.chain,
                time_limit=self._deadlines.action,
                predict=lambda begin, call: functools.partial(self._predictor.action, begin, call),
                fetches=self._fetches,
            )
        blind, self._blind = self._blind, self._lacks_ball(world)
        # Once it may happen: after a long tick, odometry may be read before a ball that has long been there.
        if self._blind and blind:
            self._end_without_ball()
            return STOP
        if self._blind or (ball_overdue and needs_ball(self.top)):
            self.reason = f"{self.top.name} pauses: no word of the ball"
            return STOP
        self._take_answer(world, self._executor)
        step = self._executor.step(world)
        self.chain = self._executor.chain
        new = self._executor.records[len(self.records) :]
        self.records += [(record, world) for record in new]
        self.elapsed = step.elapsed
        self.reason = step.message
        if step.status is Status.RUNNING:
            self.refining.ask_again(world, self.chain, now, step=self.step)
            return step.command
        if self._lacks_ball(world):  # for the step that was just handed over to
            self._end_without_ball()
        elif step.status is Status.SUCCEEDED:
            self.end(Ending.SUCCEEDED, step.message)
        elif self.records[-1][0].lost_ball:
            self.end(Ending.BALL_LOST, f"ball lost in {self.top.name}: {step.message}")
        else:
            self.end(Ending.FAILED, step.message)
        return STOP

    def _settle(self, world: World) -> None:
        self._stopped_at = min(self._stopped_at, world.time)
        if is_standing(world.robot) or world.time - self._stopped_at > _LONGEST_STOP:
            self.phase = Phase.ENDED

    def _lacks_ball(self, world: World) -> bool:
        return world.ball is None and needs_ball(self.top)

    def _end_without_ball(self) -> None:
        self.end(Ending.INPUT_LOST, f"ball is missing: {self.top.name} needs it, and no recent one is known")
