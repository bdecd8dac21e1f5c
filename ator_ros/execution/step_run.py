"""The execution of one step of a chain, and its record."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ator_ros.actions.base import Action, ActionError, Goal, Status, Step
from ator_ros.actions.goal_variables import goal_values
from ator_ros.execution.phases import Ending
from ator_ros.execution.transitions import STAGES, Stage, TransitionError
from ator_ros.geometry import FloatArray
from ator_ros.tops.chain import TopCall
from ator_ros.tops.conditions import state_of
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.objects import at_rest, followed, held_first, is_lost, kept
from ator_ros.tops.outcome import failure, may_settle, unmet
from ator_ros.world.state import STOP, World

Predict = Callable[[World], Any]

STOPPING = "stopping, to go on from there"
"""Message of a step that waits until the robot stands."""


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


class StepRun:
    """One action of a chain with one goal, from its pre-condition to its post-condition.

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
        self._stage = Stage.STANDING if standing_first else Stage.READY
        self._library, self._index = library, index
        self._time_limit, self._predict = time_limit, predict
        self._action: Action | None = None
        self._start: World | None = None
        self._settling = math.inf  # time in s since which the action's effect is awaited
        self._predicted: Any = None

    @property
    def over(self) -> bool:
        """Whether it has ended."""
        return self._stage is Stage.OVER

    @property
    def stopping(self) -> bool:
        """Whether it waits until the robot stands."""
        return self._stage is Stage.STANDING

    @property
    def begun(self) -> bool:
        """Whether its action has started."""
        return self._action is not None

    @property
    def planning(self) -> bool:
        """Whether its action has started and is still planning."""
        return self._stage is Stage.ACTING and self._acting.planning

    def way(self) -> FloatArray | None:
        """Return the planned way of its action; see `Action.way`."""
        return self._acting.way() if self._stage is Stage.ACTING else None

    @property
    def settling(self) -> bool:
        """Whether its action has ended and its effect is awaited."""
        return self._stage is Stage.SETTLING

    def defer_planning(self, time: float) -> None:
        """Let the action, if it has started, plan nothing in the tick at `time` (s)."""
        if self._stage is Stage.ACTING:
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
        if self._stage is Stage.STANDING:
            if not world.robot.is_standing:
                return Step(STOP, Status.RUNNING, STOPPING)
            self._go(Stage.READY)
        fault = self.begin(world) if self._stage is Stage.READY else None
        if fault is not None:
            return Step(STOP, Status.FAILED, fault)
        if self._stage is Stage.SETTLING:
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
            if self._stage is Stage.ACTING:
                self._go(Stage.SETTLING, step.message)
            return Step(STOP, Status.RUNNING, f"{top.name} settles: {'; '.join(lacks)}")
        return Step(STOP, Status.FAILED, failure(top, lacks))

    def end(self, reason: str) -> None:
        """End the step, and its action if that runs; see `Action.end`."""
        self._go(Stage.OVER, reason)

    def _go(self, stage: Stage, why: str = "") -> None:
        """Go on to the next stage; the action ends, for the reason `why`, when it leaves ACTING."""
        former, self._stage = self._stage, stage
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
