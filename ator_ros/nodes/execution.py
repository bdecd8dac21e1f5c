"""The execution of one goal: refine, execute, stop (without ROS; both clocks are passed in)."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

from ator_ros.actions.base import Status
from ator_ros.nodes.predictions import Predictor
from ator_ros.refinement.chain_model import ChainPrediction
from ator_ros.tops.ball import needs_ball
from ator_ros.tops.chain import TopChain
from ator_ros.tops.executor import ChainExecutor
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.step_run import ActionRecord
from ator_ros.tops.top import Top
from ator_ros.world import STOP, Command, World

_STANDING_V = 0.02
_STANDING_W = 0.05
_LONGEST_STOP = 2.0
_NOT_ASKED = "refinement was not asked for"


class Ending(enum.Enum):
    """How a goal ended; names and values are those of Outcome.msg."""

    SUCCEEDED = 1
    FAILED = 2
    REFUSED = 3
    CANCELED = 4
    PREEMPTED = 5
    INPUT_LOST = 6
    SHUTDOWN = 7
    BALL_LOST = 8


class Phase(enum.Enum):
    """Where the execution of a goal stands."""

    WAITING = "waiting for the first state"
    REFINING = "waiting for refinement"
    EXECUTING = "executing"
    STOPPING = "stopping"
    ENDED = "ended"


@dataclass(frozen=True, slots=True)
class Deadlines:
    """When to give up waiting.

    Attributes
    ----------
    start : float
        Real time in s from the goal's acceptance until everything that its chain needs is known.
    odom : float
        Real time in s without newer odometry, once there was some.
    refinement : float
        Real time in s that refinement may take.
    action : float
        Time in s on the odometry's clock that one action may take.
    """

    start: float = 2.0
    odom: float = 0.3
    refinement: float = 0.5
    action: float = 30.0


class Execution:
    """One goal, from its acceptance until the robot stands again.

    Parameters
    ----------
    library : TopLibrary
        Gives the actions.
    chain : TopChain
        What to execute.
    refine : bool
        Whether to wait for `refined` before the start.
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
        refine: bool,
        now: float,
        predictor: Predictor,
        deadlines: Deadlines,
        fetches: int = 0,
    ) -> None:
        self.chain = chain
        self.phase = Phase.WAITING
        self.ending: Ending | None = None
        self.reason = Phase.WAITING.value
        self.refinement = _NOT_ASKED
        self.refined = False
        self.start: World | None = None
        self.predicted: ChainPrediction | None = None
        self.records: list[tuple[ActionRecord, World]] = []
        self.elapsed = 0.0
        self._library, self._predictor, self._deadlines = library, predictor, deadlines
        self._refine, self._fetches = refine, fetches
        self._accepted, self._heard, self._asked = now, math.inf, math.inf
        self._stopped_at = math.inf
        self._executor: ChainExecutor | None = None

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

    def predicted_remaining(self, now: float) -> float:
        """Give the predicted time in s from `now`, on the odometry's clock, to the end; NaN if not known."""
        if self.predicted is None or self.start is None:
            return math.nan
        began = self.records[-1][1].time if self.records else self.start.time
        current, *rest = (action.get("duration", math.nan) for action in self.predicted.actions[self.step :])
        return max(0.0, current - (now - began)) + sum(rest)

    # What happens

    def tick(self, world: World, now: float) -> Command:
        """Take a newer state of the world and give the command for it."""
        self._heard = now
        if self.phase is Phase.WAITING:
            self._begin(world, now)
        if self.phase is Phase.EXECUTING:
            return self._execute(world)
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
        if self.phase is Phase.REFINING and now - self._asked > self._deadlines.refinement:
            self.unrefined(f"no answer within {self._deadlines.refinement:g} s")
        if self.phase is not Phase.ENDED and now - self._heard > self._deadlines.odom:
            reason = f"odom is missing: expected newer odometry within {self._deadlines.odom:g} s, got none"
            self.end(Ending.INPUT_LOST, reason)
            self.phase = Phase.ENDED  # nothing will tell when the robot stands

    def end(self, ending: Ending, reason: str) -> None:
        """End for a reason from outside, or from within; the first one counts."""
        if self.ending is None:
            self.ending, self.reason, self.phase = ending, reason, Phase.STOPPING

    def refined_to(self, chain: TopChain, refined: bool, reason: str) -> None:
        """Take the answer of refinement, unless it is too late."""
        if self.phase is not Phase.REFINING:
            return
        assert self.start is not None
        violations = chain.violations(self.start, self._library.robot)
        if violations:
            self.unrefined(f"the refined chain is no valid plan: {'; '.join(violations)}")
        else:
            self.chain, self.refined, self.refinement = chain, refined, reason
            self.phase = Phase.EXECUTING

    def unrefined(self, why: str) -> None:
        """Go on with the chain as it came, unless that has happened."""
        if self.phase is Phase.REFINING:
            self.refinement = f"executed as sent, refinement failed: {why}"
            self.phase = Phase.EXECUTING

    # Phases

    def _begin(self, world: World, now: float) -> None:
        """Start with the first state in which the chain can be judged: with a ball where one is needed."""
        self.start = world
        if world.ball is None and self._ball_user() is not None:
            self.reason = "waiting for a ball"
            return
        violations = self.chain.violations(world, self._library.robot)
        if violations:
            self.end(Ending.REFUSED, f"no valid plan: {'; '.join(violations)}")
            return
        self._asked = now
        self.phase = Phase.REFINING if self._refine else Phase.EXECUTING
        self.reason = self.phase.value

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

    def _execute(self, world: World) -> Command:
        if self._executor is None:
            # Later than the first state when refinement has taken its time.
            self.start = world
            self.predicted = self._predictor.chain(world, self.chain)
            self._executor = ChainExecutor(
                self._library,
                self.chain,
                time_limit=self._deadlines.action,
                predict=self._predictor.action,
                fetches=self._fetches,
            )
        if self._ball_missing(world):
            return STOP
        step = self._executor.step(world)
        self.chain = self._executor.chain
        new = self._executor.records[len(self.records) :]
        self.records += [(record, world) for record in new]
        self.elapsed = step.elapsed
        self.reason = step.message
        if step.status is Status.RUNNING:
            return step.command
        if self._ball_missing(world):  # which the step needed that was just handed over to
            return STOP
        if step.status is Status.SUCCEEDED:
            self.end(Ending.SUCCEEDED, step.message)
        elif self.records[-1][0].lost_ball:
            self.end(Ending.BALL_LOST, f"ball lost in {self.top.name}: {step.message}")
        else:
            self.end(Ending.FAILED, step.message)
        return STOP

    def _settle(self, world: World) -> None:
        self._stopped_at = min(self._stopped_at, world.time)
        standing = abs(world.robot.v) < _STANDING_V and abs(world.robot.w) < _STANDING_W
        if standing or world.time - self._stopped_at > _LONGEST_STOP:
            self.phase = Phase.ENDED

    def _ball_missing(self, world: World) -> bool:
        """End when the present step needs the ball and none is known."""
        missing = world.ball is None and needs_ball(self.top)
        if missing:
            self.end(
                Ending.INPUT_LOST, f"ball is missing: {self.top.name} needs it, and no recent one is known"
            )
        return missing
