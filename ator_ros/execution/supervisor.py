"""Supervises one goal: waits, refines, executes, stops. Real time and stamps are passed in."""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass

from ator_ros.actions import TIME_LIMIT
from ator_ros.actions.base import Status
from ator_ros.execution.chain_executor import NOT_DONE, ChainExecutor, Ending
from ator_ros.execution.fence import Fence, FenceWatch
from ator_ros.execution.predictions import Forecast, Predictor
from ator_ros.execution.refining import AGAIN_AFTER, Answer, Question, Refining
from ator_ros.execution.rolling import Rolling
from ator_ros.execution.state_watch import DelayWatch, ObjectWatch, Timeliness
from ator_ros.geometry import FloatArray
from ator_ros.printable import printable
from ator_ros.tops.chain import InvalidChainError, Top, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.objects import at_rest, missing_in, missing_object, objects_in
from ator_ros.world.delay import Delay
from ator_ros.world.state import STOP, Command, World

WATCH_PERIOD = 0.05
"""Real time in s between two checks of the deadlines."""
GREATEST_STOP_SLOWDOWN = 5.0
"""Greatest factor by which a slow clock delays the stop command.

After a pause of some seconds a clock seems up to 50 times slower than real time, which may delay
the end of a goal but not the stop of a robot."""
LONGEST_STOP_TIME = 5.0
"""Time in s for which a robot that still moves is commanded to stop."""
_CALM = 0.5
"""Time in s for which a robot must stand after another program moved it and failed.

That may continue, as Nav2's controller server does after its navigator died."""
# least timeout of odometry in real s before a goal drives: its rate may be unknown
_FIRST_GAP = 1.0
_DELAYED = 0.1  # s above which a delay counts near the fence; less is the jitter of messages
# the same if stamps run faster than real time, as a simulation may stall, and while nodes start
_LONGEST_REASON = 275  # characters of what was observed and its cause
_FEWEST_GAPS = 3  # in one goal; one or two are no cause of its failure
_SHORTEST_REASON = 60  # of what was observed, if the cause is long
_LONGEST_STALL = 2.0


class Phase(enum.Enum):
    """Phase of a goal, in this order; REFINING is left out if no refinement is wanted.

    All ends of a goal lead to STOPPING; without odometry, or if it is dropped, it is ENDED at once.
    """

    WAITING = "waiting for the first state"
    REFINING = "waiting for refinement"
    EXECUTING = "executing"
    STOPPING = "stopping"
    ENDED = "ended"


@dataclass(frozen=True, slots=True)
class Deadlines:
    """Timeouts in real s, but for that of actions."""

    start: float = 2.0  # from the goal's acceptance until robot and objects of its chain are known
    odom: float = 0.3  # without newer odometry, after the first
    refinement: float = 5.0  # a request to a refinement node; a busy machine answers late
    action: float = TIME_LIMIT  # s on odometry's clock, for one step with all changes of its goal

    @property
    def stop_after(self) -> float:
        """Real time in s without newer odometry after which the robot should stand."""
        return self.odom / 2.0

    @property
    def longest_gap(self) -> float:
        """Greatest real time in s from the last odometry until the robot is commanded to stand."""
        return self.stop_after + WATCH_PERIOD


class Supervisor:
    """One goal, from its acceptance until the robot stands again; see `Phase`.

    Attributes
    ----------
    ending : Ending or None
        How the goal ended; None before.
    reason : str
        A sentence on the present activity; after the end, on its cause.
    start : World or None
        The state in which the chain started, before that the newest one; None if there was none.
    executor, refining, forecast : ChainExecutor, Refining, Forecast
        The chain with its present goals, the questions to refinement, and the predictions of the
        chain.
    slowdown : float
        Factor for the timeouts of odometry in real time: above 1 if its clock is slow.
    may_stall : bool
        Whether odometry may be missing for up to 2 s: its clock is faster than real time, or
        nodes are starting. The robot stands meanwhile.

    Parameters
    ----------
    now : float
        Real time in s, in all methods; the time of states is that of odometry's clock.
    refine, again_after : bool, float
        See `Refining`; the chain starts after the first answer.
    fetches, rolling : int, Rolling
        See `ChainExecutor`.
    delay : Delay, optional
        The delay of states, see `Delay`, updated by the caller; without it, no state is late.
    alternatives : sequence of TopChain
        Other chains for the same end: refinement may choose one of them, and without it the first
        valid plan is executed.
    """

    def __init__(
        self,
        library: TopLibrary,
        chain: TopChain,
        *,
        now: float,
        predictor: Predictor,
        deadlines: Deadlines,
        fence: Fence,
        refine: bool = False,
        again_after: float = AGAIN_AFTER,
        fetches: int = 0,
        alternatives: Sequence[TopChain] = (),
        rolling: Rolling | None = None,
        delay: Delay | None = None,
    ) -> None:
        self.phase = Phase.WAITING
        self.ending: Ending | None = None
        self.reason = Phase.WAITING.value
        self.start: World | None = None
        self.slowdown = 1.0
        self.may_stall = False
        self._gaps = list[float]()  # s; gaps in odometry in which the robot had to stand
        self.executor = ChainExecutor(
            library,
            chain,
            time_limit=deadlines.action,
            fetches=fetches,
            rolling=rolling,
            models=predictor.models,
        )
        plans = (chain, *alternatives)
        self.refining = Refining(
            self.executor, library, plans, wanted=refine, fence=fence, again_after=again_after
        )
        self.forecast = Forecast(predictor, self.executor)
        self._plans = plans
        self._robot = library.robot
        self._deadlines = deadlines
        self._area = fence
        self._fence = FenceWatch(fence, library.robot, deadlines.longest_gap)
        self._delays = DelayWatch(library.robot, deadlines.odom, delay or Delay())
        self._objects = ObjectWatch(library.robot)
        self._missing: str | None = None  # an object that the last state lacked
        self._newest: World | None = None
        self._accepted = now
        self._odom_at = math.inf
        self._stopped_at = self._stood_at = math.inf
        self._was_released = False

    @property
    def question(self) -> Question | None:
        """The open question to refinement; None if there is none."""
        return self.refining.question if self.phase in (Phase.REFINING, Phase.EXECUTING) else None

    def path(self) -> FloatArray | None:
        """Return the planned path of the active action; see `Action.path`."""
        return self.executor.path() if self.phase is Phase.EXECUTING else None

    def predicted_remaining(self, now: float) -> float:
        """Return the predicted time in s from `now`, on odometry's clock, to the end.

        NaN if unknown.
        """
        return 0.0 if self.ending is not None else self.forecast.remaining(now)

    # Ticks

    def tick(
        self,
        world: World,
        now: float,
        *,
        overdue: frozenset[str] = frozenset(),
        fault: str | None = None,
    ) -> Command | None:
        """Process a newer state; return the command, None if another program moves the robot.

        A step that needs an `overdue` object, one without recent messages, pauses. A `fault` of the
        base, see `MotionWatch`, ends the goal.
        """
        if fault is not None and self._delays.is_doubtful:
            self._end_late()
        elif fault is not None:
            self.base_fault(fault)
        if self.odometry_is_late(now):
            self._gaps.append(now - self._odom_at)
        self._odom_at = now
        self._newest = world
        # The first command, to stand, makes a simulation wait for the next one, which requires
        # planning.
        if self.phase is Phase.WAITING and self._begin(world, now) and world.robot.is_standing:
            return STOP
        if self.phase is Phase.EXECUTING:
            return self._execute(world, now, overdue=overdue)
        if self.phase is Phase.STOPPING:
            self._stop(world)
        return STOP

    def _begin(self, world: World, now: float) -> bool:
        """Start the first plan that is valid and whose objects are known.

        Wait if there is none, but a plan lacks objects. Return whether it is executed now.
        """
        self.start = world
        reasons = []
        for number, plan in enumerate(self._plans):
            if missing_in(plan.calls, world):
                continue
            try:
                valid = self.refining.valid(plan, world)
            except InvalidChainError as error:
                reasons.append(str(error))
                continue
            off = self._area.unreachable(valid, self._robot, "chain", world.robot.pose[:2])
            if off is None:
                self.refining.start_with(number, valid)
                break
            reasons.append(off)
        else:
            unknown = self._unknown(world)
            if unknown is not None:
                self.reason = f"waiting for the {unknown[0]}"
            else:
                self.end(Ending.REFUSED, f"no valid plan: {' | '.join(reasons)}")
            return False
        if self.refining.wanted:
            self.refining.ask(world, now)
            self.forecast.change(world)  # for feedback until the answer
        self.phase = Phase.REFINING if self.refining.wanted else Phase.EXECUTING
        self.reason = self.phase.value
        return not self.refining.wanted

    def _unknown(self, world: World) -> tuple[str, str] | None:
        """Return the first object that a plan lacks, and the TOP that needs it."""
        lacking = (missing_in(plan.calls, world) for plan in self._plans)
        return next((each for each in lacking if each is not None), None)

    def _execute(self, world: World, now: float, *, overdue: frozenset[str]) -> Command | None:
        if not self.forecast.begun:
            self.start = world  # later than the first state if refinement took time
            self.forecast.begin(world)
        pause = self._guard(world, overdue)
        if self.phase is not Phase.EXECUTING:
            return STOP
        if pause and not self.executor.released:
            self.reason = pause
            return STOP
        if self.refining.apply(world):
            self.forecast.change(at_rest(world, self._robot))
        step = self.executor.step(world)
        self._was_released = self._was_released or self.executor.released
        self.reason = step.message
        if step.status is Status.RUNNING:
            self.refining.ask_again(world, now)
            return step.command
        if step.status is not Status.SUCCEEDED and self.refining.revert(world, step.message):
            self.forecast.change(at_rest(world, self._robot))
            return STOP
        last = self.executor.records[-1]
        missing = missing_object(self._top, world)
        if missing is not None:
            self._end_without(missing, self._top)
        elif last.lost is not None:
            self.end(Ending.OBJECT_LOST, f"{last.lost} lost in {self._top.name}: {step.message}")
        else:
            self.end(Ending.FAILED if last.ending in NOT_DONE else last.ending, step.message)
        return STOP

    def _guard(self, world: World, overdue: frozenset[str]) -> str:
        """Check inputs and fence, which end or pause any step; return why it pauses, or "".

        The goal ends if an object is unknown in two states in a row. It may be missing in one
        state, as after a long tick odometry may be read before the object's message.
        """
        top = self._top
        before = self._missing
        self._missing = missing_object(top, world)
        if self._missing and before:
            self._end_without(self._missing, top)
            return ""
        late = self._missing or next((name for name in objects_in(top) if name in overdue), None)
        if late:
            return f"{top.name} paused: no recent message of the {late}"
        fault = self._fence.fault(world, self.executor.call)
        if fault is not None:
            self.end(Ending.OUT_OF_BOUNDS, fault)
        impossible = self._objects.fault(world, top)
        if impossible is not None:
            self.end(Ending.INPUT_LOST, impossible)
        if self._is_late(world):
            return (
                f"{top.name} paused: states are {self._delays.greatest:.1f} s old when they are "
                "read"
            )
        delay = self._delays.seconds
        if delay > _DELAYED and self._fence.may_leave(world, min(delay, self._deadlines.odom)):
            return f"{top.name} paused: states are {delay:.1f} s old, and the fence is near"
        return (
            f"{top.name} paused: the followed object is outside the fence"
            if self._fence.pausing
            else ""
        )

    def _is_late(self, world: World) -> bool:
        """Return whether the robot should stand because states are delayed; end if they are late.

        Another program that moves the robot cannot be commanded to stand.
        """
        if self.executor.released:
            return False
        found = self._delays.judge(world)
        if found is Timeliness.LATE:
            self._end_late()
        return found is not Timeliness.IN_TIME

    def _end_late(self) -> None:
        self.end(
            Ending.INPUT_LOST,
            f"odom is late: expected states that are at most {self._deadlines.odom:g} s old when "
            f"they are read, got {self._delays.greatest:.2f} s; the network, a node that publishes "
            "them or this machine cannot keep up",
        )

    def _end_without(self, name: str, top: Top) -> None:
        self.end(
            Ending.INPUT_LOST, f"{name} is missing: {top.name} needs it, and no recent one is known"
        )

    @property
    def _top(self) -> Top:
        return self.executor.call.top

    def _stop(self, world: World) -> None:
        """Wait until the robot stands, or until the timeout."""
        stands = world.robot.is_standing
        self._stopped_at = min(self._stopped_at, world.time)
        self._stood_at = min(self._stood_at, world.time) if stands else math.inf
        late = world.time - self._stopped_at > LONGEST_STOP_TIME
        if late and not stands:
            self.explain(
                f"the robot still moves at {world.robot.speed:.2f} m/s and "
                f"{world.robot.w:.2f} rad/s, {LONGEST_STOP_TIME:g} s after it was commanded to stop"
            )
        calm = _CALM if self._was_released and self.ending is Ending.FAILED else 0.0
        if late or world.time - self._stood_at >= calm:
            self.phase = Phase.ENDED

    # Deadlines

    def odometry_is_late(self, now: float) -> bool:
        """Return whether the robot must stand: odometry is missing for half its timeout.

        A slow clock makes that at most `GREATEST_STOP_SLOWDOWN` times longer. If another program
        moves the robot, commands would interfere.
        """
        released = self.phase is Phase.EXECUTING and self.executor.released
        waiting = self.phase is not Phase.ENDED and not released
        slowdown = min(self.slowdown, GREATEST_STOP_SLOWDOWN)
        return waiting and now - self._odom_at > slowdown * self._deadlines.stop_after

    @property
    def gap_problem(self) -> str:
        """That odometry had gaps in which the robot had to stand, several times; else empty."""
        if len(self._gaps) < _FEWEST_GAPS:
            return ""
        return (
            f"odom: expected messages at most {self._deadlines.stop_after:.2f} s apart, got "
            f"{len(self._gaps)} longer gaps, up to {max(self._gaps):.2f} s, in which the robot "
            "stood: check the network and its driver"
        )

    def odometry_received(self, now: float) -> None:
        """Restart the timeout of odometry at `now`, as messages of a tick are not late."""
        self._odom_at = now

    def postpone(self, now: float, why: str) -> None:
        """Restart the timeout of a goal that cannot start yet."""
        if self.phase is Phase.WAITING:
            self._accepted = now
            self.reason = why

    def watch(self, now: float) -> None:
        """Check all timeouts at `now`."""
        start = self.slowdown * self._deadlines.start
        if self.phase is Phase.WAITING and now - self._accepted > start:
            expected = f"expected one within {start:.3g} s of the goal"
            if self.start is None:
                got = "got none" if math.isinf(self._odom_at) else "it came too late"
                self.end(Ending.INPUT_LOST, f"odom is missing: {expected}, {got}")
                self.phase = Phase.ENDED
            else:
                name, top = self._unknown(self.start) or ("", "")
                self.end(
                    Ending.INPUT_LOST, f"{name} is missing: {top} needs it, {expected}, got none"
                )
        if self.question is not None and now - self.question.asked > self._deadlines.refinement:
            within = f"{self._deadlines.refinement:g} s"
            why = f"no answer within {within}; is a refinement node running?"
            self.answer(Answer(None, False, why))
        limit = self.slowdown * self._deadlines.odom
        if self.phase is Phase.WAITING:
            limit = max(limit, _FIRST_GAP)
        if self.may_stall:
            limit = max(limit, _LONGEST_STALL)
        if self.phase is not Phase.ENDED and now - self._odom_at > limit:
            reason = f"odom is missing: expected newer odometry within {limit:.3g} s, got none"
            self.end(Ending.INPUT_LOST, reason)
            self.phase = Phase.ENDED  # no state will show that the robot stands

    # Answers of refinement

    def answer(self, answer: Answer) -> None:
        """Process the answer to `question`; without a question it is ignored."""
        if self.question is None:
            return
        self.refining.answer(answer)
        if self.phase is Phase.REFINING:
            self.phase = Phase.EXECUTING
            self.reason = self.phase.value  # for feedback before the next tick

    # The end

    def end(self, ending: Ending, reason: str) -> None:
        """End the goal, and record an active action as interrupted.

        Only the first call has an effect.
        """
        if self.ending is not None:
            return
        if self._newest is not None:
            self.executor.interrupt(self._newest, ending, reason)
        self.phase = Phase.STOPPING
        self.ending = ending
        self.reason = reason
        if math.isinf(self._odom_at):  # without any odometry its timeout counts from the acceptance
            self._odom_at = self._accepted

    def base_fault(self, reason: str) -> None:
        """End because the base does not follow its commands.

        Also after a success, until the base stands.
        """
        if self.ending is Ending.SUCCEEDED and self.phase is Phase.STOPPING:
            self.ending = Ending.BASE_FAULT
            self.reason = reason
        self.end(Ending.BASE_FAULT, reason)

    def explain(self, cause: str) -> None:
        """Add a cause, if it is known, to the reason of the end."""
        if cause and cause not in self.reason:
            # The cause says what to do; what was observed is shortened for it.
            room = max(_SHORTEST_REASON, _LONGEST_REASON - len(cause))
            observed = printable(self.reason, room)
            self.reason = f"{observed}; {cause}"

    def drop(self) -> None:
        """End a goal that stops at once, without waiting until the robot stands."""
        if self.phase is Phase.STOPPING:
            self.phase = Phase.ENDED
