"""The chain executor: calls the action of each TOP in turn (paper, section 2.2), tick by tick."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from ator_ros.actions import TIME_LIMIT
from ator_ros.actions.base import Action, ActionError, Goal, Status, Step
from ator_ros.actions.goal_variables import goal_values
from ator_ros.execution.rolling import Rolling
from ator_ros.geometry import FloatArray
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.conditions import state_of
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.objects import (
    at_object,
    at_rest,
    fetched,
    followed,
    has_left,
    held_first,
    is_at_front,
    is_in_the_way,
    is_lost,
    kept,
)
from ator_ros.tops.outcome import failure, may_settle, unmet
from ator_ros.world.state import STOP, Command, World

Predict = Callable[[World], Any]

STOPPING = "stopping, to go on from there"
"""Message of a step that waits until the robot stands."""
_STAYED = 0.02
"""Distance in m, and angle in rad, within which a robot has stayed where it was."""


class Ending(enum.Enum):
    """How a goal or an action ended; names and values are those of Outcome.msg."""

    SUCCEEDED = 1
    FAILED = 2
    REFUSED = 3
    CANCELED = 4
    PREEMPTED = 5
    INPUT_LOST = 6
    SHUTDOWN = 7
    OBJECT_LOST = 8
    BASE_FAULT = 9
    OUT_OF_BOUNDS = 10


_ENDINGS = {Status.SUCCEEDED: Ending.SUCCEEDED, Status.FAILED: Ending.FAILED}


class Stage(enum.Enum):
    """Where one step of a chain is, while its goal is in the phase EXECUTING."""

    STANDING = "waiting until the robot stands"
    READY = "ready to start its action"
    ACTING = "its action runs"
    SETTLING = "its action has ended, its effect is awaited"
    OVER = "over"


STAGES: Mapping[Stage, frozenset[Stage]] = MappingProxyType(
    {
        Stage.STANDING: frozenset({Stage.READY, Stage.OVER}),
        Stage.READY: frozenset({Stage.ACTING, Stage.OVER}),
        Stage.ACTING: frozenset({Stage.SETTLING, Stage.OVER}),
        Stage.SETTLING: frozenset({Stage.OVER}),
        Stage.OVER: frozenset(),
    }
)
"""The stages that may follow each stage; an action is ended when its step leaves ACTING."""


class TransitionError(RuntimeError):
    """An event without a transition in the present phase: a fault of the program."""


@dataclass(frozen=True, slots=True)
class ActionRecord:
    """How one action of a chain went.

    Attributes
    ----------
    index : int
        Step of the chain, from 0.
    top, action : str
        Names of the TOP and of its action.
    start : World
        Situation in which the action started.
    goal : Goal
        Its goal.
    end : World
        Situation in which it ended.
    duration : float
        Time it took in s.
    ending : Ending
        SUCCEEDED, FAILED, or why it was broken off: PREEMPTED by another goal of the same step, for example
        because an object had moved, or the ending of the whole chain.
    reason : str
        A sentence on how it ended.
    position_error, heading_error : float
        Distance from the goal at the end in m, difference of headings in rad.
    predicted : object
        What the performance model predicted at the start; None without one.
    lost : str or None
        The object whose loss made it fail; None if it did not fail, or not for that reason.
    """

    index: int
    top: str
    action: str
    start: World
    goal: Goal
    end: World
    duration: float
    ending: Ending
    reason: str
    position_error: float
    heading_error: float
    predicted: Any = None
    lost: str | None = None


@dataclass(frozen=True, slots=True)
class ChainStep:
    """One tick of a chain: command, status, step (from 0), a sentence, time since the start in s."""

    command: Command | None
    status: Status
    index: int
    message: str
    elapsed: float


class ChainExecutor:
    """Executes a TOP chain, and owns it: its present goals, the step it is at, and the records.

    Attributes
    ----------
    chain : TopChain
        The chain with its present goals: goals that lie at an object move with it.
    index : int
        Index of the step being executed, from 0.
    records : list of ActionRecord
        The actions that have ended.
    fetched : int
        Number of times that a lost object was fetched again.

    Parameters
    ----------
    library : TopLibrary
        TOPs and actions.
    chain : TopChain
        The chain to execute; each pre-condition is checked before its step starts.
    time_limit : float
        Time in s that each step may take, including all changes of its goal.
    predict : callable, optional
        Predicts the performance of a step for its record, given the world in which it starts, the chain, and
        its index (from 0).
    fetches : int
        Number of times that a lost object may be fetched again; the chain then goes on from the latest step
        that fetches it.
    rolling : Rolling, optional
        Observed deceleration of rolling objects, updated by the caller. Steps use it if they begin from a
        stand, because actions compute tables for it.
    """

    def __init__(
        self,
        library: TopLibrary,
        chain: TopChain,
        *,
        time_limit: float = TIME_LIMIT,
        predict: Callable[[World, TopChain, int], Any] | None = None,
        fetches: int = 0,
        rolling: Rolling | None = None,
    ) -> None:
        self._described, self._rolling = library, rolling
        self._library = self._corrected_library()
        self.chain = chain
        self._time_limit = time_limit
        self._predict = predict
        self._fetches = fetches
        self._began: float | None = None
        self._planned = -math.inf  # when a step was last planned while another was driven, s
        self._last: ChainStep | None = None
        self.records: list[ActionRecord] = []
        self.fetched = 0
        self.index = 0
        self._run = self._new_run(chain, 0)

    def choose(self, chain: TopChain) -> None:
        """Execute `chain` instead of the one given; only before the first tick."""
        assert self._began is None
        self.chain, self._run = chain, self._new_run(chain, 0)

    def begin_again(self, chain: TopChain) -> bool:
        """Execute `chain` instead if the first action failed where it began; return whether it did."""
        first = self.records[0] if self.records else None
        if len(self.records) != 1 or first is None or first.index or first.ending is not Ending.FAILED:
            return False
        there, here = first.start.robot.pose, first.end.robot.pose
        stayed = there.distance(here) <= _STAYED and abs(there.relative(here).yaw) <= _STAYED
        if first.lost is not None or not stayed or chain.calls[0] == self.chain.calls[0]:
            return False
        self.chain = chain
        self._enter(0, standing_first=True)
        return True

    def step(self, world: World) -> ChainStep:
        """Return the command of this tick; after an action ends, the next one begins in the same tick.

        At most one action begins per tick, because each plans.
        """
        if self._began is None:
            self._began = world.time
        step = self._follow(world)
        while step is None:
            waiting = not self._run.begun
            step = self._run.step(world)
            if step.status is Status.RUNNING:
                break
            self.records.append(self._run.close(world, _ENDINGS[step.status], step.message))
            following = self._after(world, step.status)
            if following is None:
                return self._chain_step(world, Step(STOP, step.status, step.message))
            self._enter(*following)
            if self._run.stage is Stage.STANDING:
                step = Step(STOP, Status.RUNNING, STOPPING)
            elif waiting or self._planned == world.time:
                step = Step(step.command, Status.RUNNING, step.message)
            else:
                step = self._follow(world)
        return self._chain_step(world, step)

    def break_off(self, world: World, ending: Ending, why: str) -> None:
        """End the action under way, if any, and record it as ended by `ending` in the state `world`."""
        if self._run.begun and self._run.stage is not Stage.OVER:
            self.records.append(self._run.close(world, ending, why))

    def path(self) -> FloatArray | None:
        """Return the planned path of the active action; see `Action.path`."""
        return self._run.path()

    @property
    def call(self) -> TopCall:
        """The step being executed, with its present goal."""
        return self.chain.calls[self.index]

    @property
    def elapsed(self) -> float:
        """Time in s from the first tick to the last one."""
        return 0.0 if self._last is None else self._last.elapsed

    @property
    def released(self) -> bool:
        """Whether another program moves the robot: the last tick had no command."""
        return self._last is not None and self._last.command is None

    def head_for(self, world: World, chain: TopChain) -> bool:
        """Replace the present step and later ones, or their goals, without a stop.

        Parameters
        ----------
        world : World
            The present state.
        chain : TopChain
            The steps that are done, and the others from here on.

        Returns
        -------
        bool
            False if no path for the changed step is found in this tick; then nothing has changed.
        """
        if chain.calls[self.index] != self._run.call:
            run = self._changed_run(chain, standing_first=self._run.stage is Stage.STANDING)
            if self._run.stage is Stage.SETTLING or (self._run.begun and self._is_blocked(world)):
                return False
            if self._run.begun and not self._begins(world, run):
                return False
            self._replace_run(world, run)
        self.chain = chain
        return True

    def _begins(self, world: World, run: StepRun) -> bool:
        """Begin `run` while the robot drives; return whether its path was planned in this tick."""
        self._planned = world.time
        self._run.defer_planning(world.time)  # it may go on after all: one search per tick
        planned = run.begin(world) is None and not run.planning
        if not planned:
            run.end("no path from here was found in one tick: the former goal stays")
        return planned

    def _follow(self, world: World) -> Step | None:
        """Move the goal with an object that has left it; return a stop if the robot must stand first."""
        robot, call = self._library.robot, self._run.call
        name = followed(call.top)
        if name is None or (self._run.begun and is_at_front(world, robot, name)):
            return None
        resting = at_rest(world, robot)
        if not has_left(resting, call, robot) or self._planned == world.time:
            return None
        chain = self.chain.with_goal(self.index, at_object(call.goal, resting, name))
        if self.head_for(world, chain):
            return None
        self._replace_run(world, self._changed_run(chain, standing_first=True))
        self.chain = chain
        return Step(STOP, Status.RUNNING, STOPPING)

    def _is_blocked(self, world: World) -> bool:
        """Return whether the followed object lies so close ahead that the robot can only stop."""
        name = followed(self._run.call.top)
        return name is not None and is_in_the_way(world, self._library.robot, name)

    def _replace_run(self, world: World, run: StepRun) -> None:
        if self._run.begun:
            self.records.append(self._run.close(world, Ending.PREEMPTED, "another goal took over"))
        self._run = run

    def _after(self, world: World, status: Status) -> tuple[int, bool] | None:
        """Return the next step and whether the robot must stand first; None at the end of the chain."""
        if status is Status.SUCCEEDED:
            return (self.index + 1, False) if self.index + 1 < len(self.chain) else None
        fetching = self._fetching_step(world)
        if fetching is None:
            return None
        self.fetched += 1
        return fetching, True

    def _fetching_step(self, world: World) -> int | None:
        """Return the step that fetches a lost object again; None if none is lost or may be fetched."""
        top = self._run.call.top
        name = held_first(top) or (fetched(top) if self._run.begun else None)
        if name is None or self.fetched >= self._fetches or not is_lost(world, self._library.robot, name):
            return None
        before = (i for i in range(self.index, -1, -1) if fetched(self.chain.calls[i].top) == name)
        return next(before, None)

    def _enter(self, index: int, standing_first: bool) -> None:
        self.index = index
        if standing_first:
            self._library = self._corrected_library()
        self._run = self._new_run(self.chain, index, standing_first=standing_first)

    def _corrected_library(self) -> TopLibrary:
        """Return the TOPs and actions for the scene with observed decelerations."""
        return self._described if self._rolling is None else self._rolling.library(self._described)

    def _changed_run(self, chain: TopChain, *, standing_first: bool) -> StepRun:
        """Return a run of the present step with its goal in `chain`; its time limit keeps running."""
        return self._new_run(chain, self.index, standing_first=standing_first, since=self._run.since)

    def _new_run(
        self, chain: TopChain, index: int, *, standing_first: bool = False, since: float | None = None
    ) -> StepRun:
        predict = self._predict
        return StepRun(
            self._library,
            index,
            chain.calls[index],
            time_limit=self._time_limit,
            predict=None if predict is None else lambda world: predict(world, chain, index),
            standing_first=standing_first,
            since=since,
        )

    def _chain_step(self, world: World, step: Step) -> ChainStep:
        assert self._began is not None
        elapsed = world.time - self._began
        self._last = ChainStep(step.command, step.status, self.index, step.message, elapsed)
        return self._last


class StepRun:
    """One action of a chain with one goal, from its pre-condition to its post-condition.

    Attributes
    ----------
    stage : Stage
        Where it is.
    call : TopCall
        The step.
    since : float or None
        Time in s from which its limit counts.

    Parameters
    ----------
    library : TopLibrary
        TOPs and actions.
    index : int
        Index of the step, from 0.
    call : TopCall
        The step to execute.
    time_limit : float
        Time in s that it may take, including the stop before it.
    predict : callable, optional
        Predicts the performance of the step from the world in which it starts.
    standing_first : bool
        Whether the robot must stand before the action starts.
    since : float, optional
        Time in s from which the limit counts, if this run replaces one with another goal.
    """

    def __init__(
        self,
        library: TopLibrary,
        index: int,
        call: TopCall,
        *,
        time_limit: float,
        predict: Predict | None = None,
        standing_first: bool = False,
        since: float | None = None,
    ) -> None:
        self.call = call
        self.since = since
        self.stage = Stage.STANDING if standing_first else Stage.READY
        self._library, self._index = library, index
        self._time_limit, self._predict = time_limit, predict
        self._action: Action | None = None
        self._start: World | None = None
        self._settling = math.inf  # time in s since which the action's effect is awaited
        self._predicted: Any = None

    @property
    def begun(self) -> bool:
        """Whether its action has started."""
        return self._action is not None

    @property
    def planning(self) -> bool:
        """Whether its action has started and is still planning."""
        return self.stage is Stage.ACTING and self._acting.planning

    def path(self) -> FloatArray | None:
        """Return the planned path of its action; see `Action.path`."""
        return self._acting.path() if self.stage is Stage.ACTING else None

    def defer_planning(self, time: float) -> None:
        """Let the action, if it has started, plan nothing in the tick at `time` (s)."""
        if self.stage is Stage.ACTING:
            self._acting.defer_planning(time)

    def begin(self, world: World) -> str | None:
        """Start the action; return the reason if that is impossible."""
        call, robot = self.call, self._library.robot
        seen = at_rest(world, robot) if followed(call.top) else world
        violations = call.top.pre.violations(state_of(seen, robot), goal_values(call.goal))
        if violations:
            return f"pre-condition of {call.top.name}: {'; '.join(violations)}"
        try:
            action = self._library.action(call.top)
            action.start(world, call.goal)
        except ActionError as error:
            return str(error)
        self._action, self._start = action, world
        self._go(Stage.ACTING)
        self._predicted = None if self._predict is None else self._predict(world)
        return None

    def step(self, world: World) -> Step:
        """Return the command of this tick; start the action if it has not started."""
        self.since = world.time if self.since is None else self.since
        step = self._next(world)
        if step.status is Status.RUNNING and world.time - self.since > self._time_limit:
            return Step(STOP, Status.FAILED, f"{self.call.top.name} took longer than {self._time_limit:g} s")
        return step

    def _next(self, world: World) -> Step:
        if self.stage is Stage.STANDING:
            if not world.robot.is_standing:
                return Step(STOP, Status.RUNNING, STOPPING)
            self._go(Stage.READY)
        fault = self.begin(world) if self.stage is Stage.READY else None
        if fault is not None:
            return Step(STOP, Status.FAILED, fault)
        if self.stage is Stage.SETTLING:
            return self._confirmed(world, Step(STOP, Status.SUCCEEDED, f"{self.call.top.name} has settled"))
        return self._confirmed(world, self._acting.step(world))

    @property
    def _acting(self) -> Action:
        assert self._action is not None
        return self._action

    def _confirmed(self, world: World, step: Step) -> Step:
        """Return `step`; a failure or a stop to settle if the action succeeded without its post-condition."""
        if step.status is not Status.SUCCEEDED:
            return step
        top = self.call.top
        lacks = unmet(top, world, self.call.goal, self._library.robot)
        if not lacks:
            return step
        self._settling = min(self._settling, world.time)
        if may_settle(top, world) and world.time - self._settling < top.settles:
            if self.stage is Stage.ACTING:
                self._go(Stage.SETTLING, step.message)
            return Step(STOP, Status.RUNNING, f"{top.name} settles: {'; '.join(lacks)}")
        return Step(STOP, Status.FAILED, failure(top, lacks))

    def end(self, reason: str) -> None:
        """End the step, and its action if that runs; see `Action.end`."""
        self._go(Stage.OVER, reason)

    def _go(self, stage: Stage, why: str = "") -> None:
        """Go on to the next stage; the action ends, for the reason `why`, when it leaves ACTING."""
        former, self.stage = self.stage, stage
        if stage not in STAGES[former]:
            raise TransitionError(f"stage {former.name}: expected another stage, got {stage.name}")
        if former is Stage.ACTING:
            self._acting.end(why)

    def close(self, world: World, ending: Ending, reason: str) -> ActionRecord:
        """End the step in the state `world`; return its record."""
        self.end(reason)
        call, start, robot = self.call, self._start or world, self._library.robot
        pose, goal = world.robot.pose, call.goal.robot_pose(robot)
        return ActionRecord(
            self._index,
            call.top.name,
            call.top.action,
            start,
            call.goal,
            world,
            world.time - start.time,
            ending,
            reason,
            pose.distance(goal),
            abs(pose.relative(goal).yaw),
            self._predicted,
            self._lost(world) if ending is Ending.FAILED else None,
        )

    def _lost(self, world: World) -> str | None:
        """Return the object that this step should hold and does not; None if there is none."""
        name = kept(self.call.top) if self.begun else held_first(self.call.top)
        return name if name is not None and is_lost(world, self._library.robot, name) else None
