"""The chain executor: calls the action of each TOP in turn (paper, section 2.2), tick by tick."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ator_ros.actions import TIME_LIMIT
from ator_ros.actions.base import Status, Step
from ator_ros.execution.phases import Ending
from ator_ros.execution.rolling import Rolling
from ator_ros.execution.step_run import STOPPING, ActionRecord, StepRun
from ator_ros.geometry import FloatArray
from ator_ros.tops.chain import TopCall, TopChain
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
)
from ator_ros.world.state import STOP, Command, World

_STAYED = 0.02
"""Distance in m, and angle in rad, within which a robot has stayed where it was."""
_ENDINGS = {Status.SUCCEEDED: Ending.SUCCEEDED, Status.FAILED: Ending.FAILED}


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
        What is known of how objects roll; whoever ticks the executor lets it observe. Steps that begin from a
        stand use it, because actions compute tables for it.
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
        self._library = self._library_as_seen()
        self._chain = chain
        self._time_limit = time_limit
        self._predict = predict
        self._fetches = fetches
        self._began: float | None = None
        self._planned = -math.inf  # when a step was last planned while another was driven, s
        self._last: ChainStep | None = None
        self.records: list[ActionRecord] = []
        self.fetched = 0
        self._index = 0
        self._run = self._new_run(chain, 0)

    def choose(self, chain: TopChain) -> None:
        """Execute `chain` instead of the one given; only before the first tick."""
        assert self._began is None
        self._chain, self._run = chain, self._new_run(chain, 0)

    def begin_again(self, chain: TopChain) -> bool:
        """Execute `chain` instead if the first action failed where it began; return whether it did."""
        first = self.records[0] if self.records else None
        if len(self.records) != 1 or first is None or first.index or first.ending is not Ending.FAILED:
            return False
        there, here = first.start.robot.pose, first.end.robot.pose
        stayed = there.distance(here) <= _STAYED and abs(there.relative(here).yaw) <= _STAYED
        if first.lost is not None or not stayed or chain.calls[0] == self._chain.calls[0]:
            return False
        self._chain = chain
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
            if self._run.stopping:
                step = Step(STOP, Status.RUNNING, STOPPING)
            elif waiting or self._planned == world.time:
                step = Step(step.command, Status.RUNNING, step.message)
            else:
                step = self._follow(world)
        return self._chain_step(world, step)

    def break_off(self, world: World, ending: Ending, why: str) -> None:
        """End the action under way, if any, and record it as ended by `ending` in the state `world`."""
        if self._run.begun and not self._run.over:
            self.records.append(self._run.close(world, ending, why))

    @property
    def chain(self) -> TopChain:
        """The chain with its present goals: goals that lie at an object move with it."""
        return self._chain

    def way(self) -> FloatArray | None:
        """Return the planned way of the action under way; see `Action.way`."""
        return self._run.way()

    @property
    def index(self) -> int:
        """Index of the step being executed, from 0."""
        return self._index

    @property
    def call(self) -> TopCall:
        """The step being executed, with its present goal."""
        return self._chain.calls[self._index]

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
            False if no way for the changed present step is found at once; then nothing has changed.
        """
        if chain.calls[self._index] != self._run.call:
            run = self._changed_run(chain, standing_first=self._run.stopping)
            if self._run.settling or (self._run.begun and self._is_blocked(world)):
                return False
            if self._run.begun and not self._begins(world, run):
                return False
            self._replace_run(world, run)
        self._chain = chain
        return True

    def _begins(self, world: World, run: StepRun) -> bool:
        """Begin `run` while the robot drives; return whether its way is known."""
        self._planned = world.time
        self._run.defer_planning(world.time)  # it may go on after all: one search per tick
        known = run.begin(world) is None and not run.planning
        if not known:
            run.end("no way from here was known at once: the former goal stays")
        return known

    def _follow(self, world: World) -> Step | None:
        """Move the goal with an object that has left it; return a stop if the robot must stand first."""
        robot, call = self._library.robot, self._run.call
        name = followed(call.top)
        if name is None or (self._run.begun and is_at_front(world, robot, name)):
            return None
        resting = at_rest(world, robot)
        if not has_left(resting, call, robot) or self._planned == world.time:
            return None
        chain = self._chain.with_goal(self._index, at_object(call.goal, resting, name))
        if self.head_for(world, chain):
            return None
        self._replace_run(world, self._changed_run(chain, standing_first=True))
        self._chain = chain
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
            return (self._index + 1, False) if self._index + 1 < len(self._chain) else None
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
        before = (i for i in range(self._index, -1, -1) if fetched(self._chain.calls[i].top) == name)
        return next(before, None)

    def _enter(self, index: int, standing_first: bool) -> None:
        self._index = index
        if standing_first:
            self._library = self._library_as_seen()
        self._run = self._new_run(self._chain, index, standing_first=standing_first)

    def _library_as_seen(self) -> TopLibrary:
        """Return the TOPs and actions for the scene as it has been seen to be."""
        return self._described if self._rolling is None else self._rolling.library(self._described)

    def _changed_run(self, chain: TopChain, *, standing_first: bool) -> StepRun:
        """Return a run of the present step with its goal in `chain`; its time limit keeps running."""
        return self._new_run(chain, self._index, standing_first=standing_first, since=self._run.since)

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
        self._last = ChainStep(step.command, step.status, self._index, step.message, elapsed)
        return self._last
