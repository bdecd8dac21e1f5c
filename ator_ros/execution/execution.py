"""The execution of one goal: wait, refine, execute, stop. Both clocks are passed in."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ator_ros.actions.base import Status
from ator_ros.execution.answers import Answers
from ator_ros.execution.chain_executor import ChainExecutor
from ator_ros.execution.fence import Fence
from ator_ros.execution.guards import Fault, Guards, missing
from ator_ros.execution.phases import LONGEST_STOP_DELAY, Deadlines, Ending, Phase
from ator_ros.execution.predictions import Forecast, Predictor
from ator_ros.execution.refining import Question, Refining
from ator_ros.execution.rolling import Rolling
from ator_ros.execution.step_run import ActionRecord
from ator_ros.execution.transitions import GoalCourse, Signal
from ator_ros.geometry import FloatArray
from ator_ros.refinement.chain_prediction import ChainPrediction
from ator_ros.tops.chain import Top, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.objects import at_rest, missing_in, missing_object
from ator_ros.world.state import STOP, Command, World

LONGEST_STOP = 5.0  # s for which a robot that still moves is commanded to stop
_FIRST_GAP = 1.0
"""Real s in which a robot that does not drive yet may lack odometry, whose rate may not be known."""


class Execution:
    """One goal, from its acceptance until the robot stands again; its phases are those of `transitions`.

    Attributes
    ----------
    reason : str
        A sentence on what happens now; after the end, on why it ended.
    slowdown : float
        How many times longer the real timeouts of odometry are: 1, or more where its clock is slow.

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
    alternatives : sequence of TopChain
        Other chains for the same end: refinement may choose one of them, and without it the first valid
        plan is executed.
    rolling : Rolling, optional
        What is known of how objects roll; see `ChainExecutor`.
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
        alternatives: Sequence[TopChain] = (),
        rolling: Rolling | None = None,
    ) -> None:
        self.reason = Phase.WAITING.value
        self.slowdown = 1.0
        self._start: World | None = None
        self._robot, self._deadlines, self._refining = library.robot, deadlines, refining
        self._course = GoalCourse()
        self._executor = ChainExecutor(
            library,
            chain,
            time_limit=deadlines.action,
            predict=predictor.later,
            fetches=fetches,
            rolling=rolling,
        )
        self._forecast = Forecast(predictor, self._executor)
        self._plans = (chain, *alternatives)
        self._answers = Answers(refining, self._executor, self._course, library, self._plans)
        self._guards = Guards(fence, library.robot, deadlines.longest_gap)
        self._seen: World | None = None
        self._accepted, self._heard = now, math.inf
        self._stopped_at = math.inf

    @property
    def phase(self) -> Phase:
        """The present phase."""
        return self._course.phase

    @property
    def ending(self) -> Ending | None:
        """How the goal ended; None before."""
        return self._course.ending

    @property
    def chain(self) -> TopChain:
        """The chain with its present goals."""
        return self._executor.chain

    @property
    def records(self) -> list[ActionRecord]:
        """The actions that have ended."""
        return self._executor.records

    @property
    def start(self) -> World | None:
        """The state in which the chain started, before that the newest one; None if there was none."""
        return self._start

    @property
    def elapsed(self) -> float:
        """Time in s since the chain's start."""
        return self._executor.elapsed

    @property
    def step(self) -> int:
        """Index of the step being executed, from 0."""
        return self._executor.index

    @property
    def top(self) -> Top:
        """The TOP of the step being executed."""
        return self._executor.call.top

    @property
    def fetched(self) -> int:
        """Number of times that a lost object was fetched again."""
        return self._executor.fetched

    @property
    def predicted(self) -> ChainPrediction | None:
        """The prediction of the chain; None before its start, and without models."""
        return self._forecast.whole

    @property
    def refined(self) -> bool:
        """Whether an answer of refinement changed the chain."""
        return self._refining.refined

    @property
    def refined_again(self) -> int:
        """Number of changes by refinement after the chain's start."""
        return self._refining.again

    @property
    def refinement(self) -> str:
        """A sentence on the results of refinement."""
        return self._refining.reason

    @property
    def question(self) -> Question | None:
        """The open question to refinement; None if there is none."""
        return self._answers.question

    def way(self) -> FloatArray | None:
        """Return the planned way of the action under way; see `Action.way`."""
        return self._executor.way() if self.phase is Phase.EXECUTING else None

    def predicted_remaining(self, now: float) -> float:
        """Return the predicted time in s from `now`, on odometry's clock, to the end; NaN if unknown."""
        return 0.0 if self.ending is not None else self._forecast.remaining(now)

    def silent(self, now: float) -> bool:
        """Return whether odometry has been missing for half its deadline, so that the robot should stand.

        A slow clock makes that at most `LONGEST_STOP_DELAY` times longer.

        A robot that another program moves cannot be paused: our commands would only disturb.
        """
        released = self.phase is Phase.EXECUTING and self._executor.released
        waiting = self.phase is not Phase.ENDED and not released
        slowdown = min(self.slowdown, LONGEST_STOP_DELAY)
        return waiting and now - self._heard > slowdown * self._deadlines.silence

    def tick(self, world: World, now: float, *, overdue: frozenset[str] = frozenset()) -> Command | None:
        """Process a newer state of the world; return the command for it, None if the action sends none.

        `overdue` are the objects whose messages are late: a step that needs one pauses, see `Guards`.
        """
        self._heard, self._seen = now, world
        # The first command, to stand, makes a simulation wait for the next one, which takes planning.
        if self.phase is Phase.WAITING and self._begin(world, now) and world.robot.is_standing:
            return STOP
        if self.phase is Phase.EXECUTING:
            return self._execute(world, now, overdue=overdue)
        if self.phase is Phase.STOPPING:
            self._stopped_at = min(self._stopped_at, world.time)
            late = world.time - self._stopped_at > LONGEST_STOP
            if late and not world.robot.is_standing:
                self.explain(
                    f"the robot still moves at {world.robot.v:.2f} m/s and {world.robot.w:.2f} rad/s, "
                    f"{LONGEST_STOP:g} s after it was commanded to stop"
                )
            if late or world.robot.is_standing:
                self._course.take(Signal.STOOD)
        return STOP

    def listening(self, now: float) -> None:
        """Restart the deadline of odometry at `now`: messages that came during a tick were not missing."""
        self._heard = now

    def postpone(self, now: float, why: str) -> None:
        """Restart the deadline of a goal that has not begun, and cannot yet."""
        if self.phase is Phase.WAITING:
            self._accepted, self.reason = now, why

    def watch(self, now: float) -> None:
        """Check all deadlines at `now`."""
        if self.phase is Phase.WAITING and now - self._accepted > self.slowdown * self._deadlines.start:
            self._give_up_waiting()
        if self.question is not None and now - self.question.asked > self._deadlines.refinement:
            self.unrefined(f"no answer within {self._deadlines.refinement:g} s")
        limit = self.slowdown * self._deadlines.odom
        if self.phase is Phase.WAITING:
            limit = max(limit, _FIRST_GAP)
        if self.phase is not Phase.ENDED and now - self._heard > limit:
            reason = f"odom is missing: expected newer odometry within {limit:.3g} s, got none"
            self.end(Ending.INPUT_LOST, reason)
            self._course.take(Signal.SILENT)

    def refined_to(self, chain: TopChain, refined: bool, reason: str, *, chosen: int = 0) -> None:
        """Accept the answer to `question`; see `Answers.take`."""
        self._answers.take(chain, refined, reason, chosen=chosen)
        self._start_answered()

    def unrefined(self, why: str) -> None:
        """Continue with the unchanged chain because `question` has no valid answer."""
        self._answers.refuse(why)
        self._start_answered()

    def _start_answered(self) -> None:
        """Replace the reason "waiting for refinement" at once: feedback may be sent before the next tick."""
        if self.phase is Phase.EXECUTING and self.reason == Phase.REFINING.value:
            self.reason = self.phase.value

    def end(self, ending: Ending, reason: str) -> None:
        """End the goal, once: later reasons are ignored. An action under way is recorded as broken off."""
        if self.ending is not None:
            return
        if self._seen is not None:
            self._executor.break_off(self._seen, ending, reason)
        self._course.take(ending)
        self.reason = reason
        if math.isinf(self._heard):  # odometry never came: its deadline counts from the acceptance
            self._heard = self._accepted

    def misbehaved(self, reason: str) -> None:
        """End because the base does not follow its commands, even if only its standstill is awaited."""
        if self.ending is Ending.SUCCEEDED and self.phase is Phase.STOPPING:
            self._course.take(Ending.BASE_FAULT)
            self.reason = reason
        self.end(Ending.BASE_FAULT, reason)

    def explain(self, cause: str) -> None:
        """Add the cause of the end to its reason; empty: none is known."""
        if cause and cause not in self.reason:
            self.reason = f"{self.reason}; {cause}"

    def drop(self) -> None:
        """End a goal that stops at once, without waiting until the robot stands."""
        if self.phase is Phase.STOPPING:
            self._course.take(Signal.DROPPED)

    def _begin(self, world: World, now: float) -> bool:
        """Start once all objects that the chain needs are known; return whether it is executed now."""
        self._start = world
        unknown = missing_in(self.chain.calls, world)
        if unknown is not None:
            self.reason = f"waiting for the {unknown[0]}"
            return False
        if not self._plan(world):
            return False
        self._course.take(Signal.ASKED if self._refining.wanted else Signal.READY)
        if self._refining.wanted:
            self._refining.ask(world, self.chain, now)
        self.reason = self.phase.value
        return not self._refining.wanted

    def _plan(self, world: World) -> bool:
        """Take the first plan that is valid from `world`; end without one."""
        reasons = []
        for plan in self._plans:
            violations = plan.violations(world, self._robot)
            if not violations:
                self._executor.choose(plan)
                return True
            reasons.append("; ".join(violations))
        self.end(Ending.REFUSED, f"no valid plan: {' | '.join(reasons)}")
        return False

    def _give_up_waiting(self) -> None:
        seconds = self.slowdown * self._deadlines.start
        got = "got none" if math.isinf(self._heard) else "it came too late"
        limit = f"expected one within {seconds:.3g} s of the goal"
        if self.start is None:
            self.end(Ending.INPUT_LOST, f"odom is missing: {limit}, {got}")
            self._course.take(Signal.SILENT)
        else:
            name, top = missing_in(self.chain.calls, self.start) or ("", "")
            self.end(Ending.INPUT_LOST, f"{name} is missing: {top} needs it, {limit}, got none")

    def _execute(self, world: World, now: float, *, overdue: frozenset[str]) -> Command | None:
        if not self._forecast.begun:
            self._start = world  # later than the first state if refinement took time
            self._forecast.begin(world)
        fault = self._guards.check(world, self._executor.call, overdue)
        if isinstance(fault, Fault):
            return self._stop(*fault)
        if fault is not None and not self._executor.released:
            self.reason = fault
            return STOP
        if self._answers.apply(world):
            self._forecast.change(at_rest(world, self._robot))
        step = self._executor.step(world)
        self.reason = step.message
        if step.status is Status.FAILED and self._answers.fall_back(step.message):
            self._forecast.change(at_rest(world, self._robot))
            return STOP
        if step.status is Status.RUNNING:
            self._answers.ask_again(world, now)
            return step.command
        unknown = missing_object(self.top, world)  # of the step that has just begun
        if unknown is not None:
            return self._stop(*missing(unknown, self.top))
        last = self.records[-1]
        if last.lost is not None:
            return self._stop(Ending.OBJECT_LOST, f"{last.lost} lost in {self.top.name}: {step.message}")
        return self._stop(last.ending, step.message)

    def _stop(self, ending: Ending, reason: str) -> Command:
        self.end(ending, reason)
        return STOP
