"""The chain executor: calls the action of each TOP in turn (paper, section 2.2), tick by tick."""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from ator_ros.actions import TIME_LIMIT
from ator_ros.actions.base import Action, ActionError, Status, Step
from ator_ros.actions.goal_variables import goal_values, goals_to_stop
from ator_ros.bases.description import Robot
from ator_ros.bases.drive_parts import DriveParts, parts_of_drive
from ator_ros.execution.rolling import Rolling
from ator_ros.geometry import FloatArray
from ator_ros.refinement.chain_prediction import PredictsPerformance, takeover_of
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.conditions import state_of
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.objects import (
    at_object,
    at_rest,
    followed,
    has_left,
    held_first,
    is_at_front,
    is_lost,
    kept,
    object_fetched_by,
)
from ator_ros.world.closest_approach import ClosestApproach
from ator_ros.world.state import STOP, World

STOPPING = "stopping, then starting the action"
"""Message of a step that waits until the robot stands."""
_STAYED = 0.02  # m and rad up to which a robot has not moved
_NEAR = 1.0  # m from a goal up to which a robot that drives through it may turn off


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


_ENDINGS = {status: Ending[status.name] for status in Status if status is not Status.RUNNING}
NOT_DONE = (Ending.FAILED, Ending.REFUSED)
"""Endings of an action that did not reach its goal or that an action server rejected."""


class Stage(enum.Enum):
    """Stage of one step of a chain whose goal is in the phase EXECUTING."""

    STANDING = "waiting until the robot stands"
    READY = "ready to start its action"
    ACTING = "its action runs"
    SETTLING = "its action has ended, waiting for the effect"
    OVER = "over"


@dataclass(frozen=True, slots=True)
class ActionRecord:
    """The result of one action of a chain.

    `ending` is SUCCEEDED, FAILED, REFUSED, PREEMPTED by another goal of the same step, as when an
    object has moved, or the ending of the whole chain.
    """

    index: int  # step of the chain, from 0
    chain: TopChain  # with its goals when the action started
    start: World
    end: World
    ending: Ending
    reason: str  # a sentence on the ending
    position_error: float  # m; distance from the goal at the end, the least one where it passed
    heading_error: float  # rad
    parts: DriveParts  # by odometry
    lost: str | None = None  # the object whose loss made the action fail
    stopped: bool = True  # False: the next action took over at the end, before it passed its goal

    @property
    def top(self) -> str:
        """Name of the TOP."""
        return self.chain.calls[self.index].top.name

    @property
    def duration(self) -> float:
        """Time from start to end in s."""
        return self.end.time - self.start.time


class PassedStep:
    """A step from which the next one has taken over, until the robot has passed its goal.

    `record` ends at the takeover.
    """

    def __init__(self, record: ActionRecord, robot: Robot) -> None:
        self._record = record
        self._robot = robot
        self.index = record.index
        self._call = record.chain.calls[record.index]
        self._approach = ClosestApproach()
        self._reason = ""
        self.is_missed = True
        """Whether the post-condition has not held yet."""
        self.is_over = False
        """Whether the robot leaves the goal."""

    @property
    def taken_over_at(self) -> float:
        """Time in s at which the next step took over."""
        return self._record.end.time

    def watch(self, world: World) -> None:
        """Process a newer state."""
        distance = _distance(world, self._call, self._robot)
        if self.is_missed and distance <= self._approach.distance:
            unmet = self._call.top.unmet(world, self._call.goal, self._robot)
            self._reason = f"passed too far from its goal: {'; '.join(unmet)}"
            self.is_missed = bool(unmet)
        self.is_over = self._approach.leaves(distance)

    def record(self) -> ActionRecord:
        """Return the record with how near the robot has come to the goal."""
        near = dataclasses.replace(self._record, position_error=self._approach.distance)
        if not self.is_missed:
            return near
        return dataclasses.replace(near, ending=Ending.FAILED, reason=self._reason)


class ChainExecutor:
    """Executes a TOP chain.

    Attributes
    ----------
    chain : TopChain
        The chain with its present goals: goals that lie at an object move with it.
    index : int
        Index of the step being executed, from 0.
    fetch_count : int
        Number of times that a lost object was fetched again.
    elapsed : float
        Time in s from the first tick to the last one.
    released : bool
        Whether another program moves the robot: the last tick had no command.

    Parameters
    ----------
    time_limit : float
        Time in s that each step may take, including all changes of its goal.
    fetches : int
        Number of times that a lost object may be fetched again, by the last step that fetches it.
    rolling : Rolling, optional
        Observed deceleration of rolling objects, updated by the caller and used by steps that start
        standing.
    models : mapping, optional
        Performance models by action; they know how far before a goal the next step can take over.
    """

    def __init__(
        self,
        library: TopLibrary,
        chain: TopChain,
        *,
        time_limit: float = TIME_LIMIT,
        fetches: int = 0,
        rolling: Rolling | None = None,
        models: Mapping[str, PredictsPerformance] = MappingProxyType({}),
    ) -> None:
        self._described = library
        self._rolling = rolling
        # Of the robot with the observed deceleration of rolling objects instead of the described
        # one.
        self._library = library if rolling is None else rolling.library(library)
        self.chain = chain
        self._time_limit = time_limit
        self._fetches = fetches
        self._models = models
        self._passed: list[PassedStep] = []  # oldest first; their records are not complete
        self._began: float | None = None  # s; first tick
        self._replanned_at = -math.inf  # s; when the active step was last planned with another goal
        self.elapsed = 0.0
        self.released = False
        self.records: list[ActionRecord] = []
        self.fetch_count = 0
        self.index = 0
        self._run = self._new_run(chain, 0)

    def choose(self, chain: TopChain) -> None:
        """Execute `chain` instead; only before the first tick."""
        self.chain = chain
        self._run = self._new_run(chain, self.index)

    def fall_back_to(self, chain: TopChain) -> bool:
        """Execute `chain` instead if the first one failed before the robot moved.

        Return whether it did.
        """
        if (
            len(self.records) != 1
            or self.records[0].index
            or self.records[0].ending not in NOT_DONE
        ):
            return False
        start = self.records[0].start.robot.pose
        end = self.records[0].end.robot.pose
        stayed = start.distance(end) <= _STAYED and abs(start.relative(end).yaw) <= _STAYED
        if self.records[0].lost is not None or not stayed or chain.calls[0] == self.chain.calls[0]:
            return False
        self.chain = chain
        self.index = 0
        self._run = self._new_run(chain, self.index, standing_first=True)
        return True

    def step(self, world: World) -> Step:
        """Return the command of this tick; the next action starts in the tick in which one ends.

        At most one action starts per tick, because each plans.
        """
        self._began = world.time if self._began is None else self._began
        self.elapsed = world.time - self._began
        for passed in self._passed:
            passed.watch(world)
        step = self._next(world)
        self.released = step.command is None
        return step

    def _next(self, world: World) -> Step:
        missed = self._finish_passed()
        step = self._follow(world) if missed is None else self._stop_at(world, missed)
        while step is None:
            was_waiting = not self._run.begun
            step = self._run.step(world)
            status = step.status
            if status is Status.RUNNING:
                break
            if self._run.hands_over and (
                self._take_over(world, step.message) or self._run.continue_to_goal(world)
            ):
                step = self._follow(world)
                continue
            missed = self._finish_passed(at_once=True)
            self.records.append(self._run.close(world, _ENDINGS[status], step.message))
            if self._run.is_missed or (missed is not None and status is Status.SUCCEEDED):
                return self._stop_at(world, self.index if missed is None else missed)
            following = self._after(world, status)
            if following is None:
                return Step(STOP, status, step.message)
            self.index, standing_first = following
            if standing_first and self._rolling is not None:
                self._library = self._rolling.library(self._described)
            self._run = self._new_run(self.chain, self.index, standing_first=standing_first)
            if standing_first:
                step = Step(STOP, Status.RUNNING, STOPPING)
            elif was_waiting or self._replanned_at == world.time:  # an action planned in this tick
                step = Step(step.command, Status.RUNNING, step.message)
            else:
                step = self._follow(world)
        return step

    def interrupt(self, world: World, ending: Ending, why: str) -> None:
        """Record the active action, if any, as ended by `ending` in the state `world`."""
        for passed in self._passed:
            record = passed.record()
            if passed.is_missed:
                record = dataclasses.replace(record, ending=ending, reason=why)
            self.records.append(record)
        self._passed.clear()
        if self._run.begun and self._run.stage is not Stage.OVER:
            self.records.append(self._run.close(world, ending, why))

    def path(self) -> FloatArray | None:
        """Return the planned path of the active action; see `Action.path`."""
        action = self._run.action
        return None if action is None else action.path()

    @property
    def call(self) -> TopCall:
        """The step being executed, with its present goal."""
        return self.chain.calls[self.index]

    def switch_to(self, world: World, chain: TopChain) -> bool:
        """Replace the present step and later ones, or their goals, without a stop.

        `chain` consists of the steps that are done and the new ones. Returns False, and changes
        nothing, if the changed step has no path from here.
        """
        if chain.calls[self.index] != self._run.call:
            standing_first = self._run.stage is Stage.STANDING
            run = self._new_run(
                chain, self.index, standing_first=standing_first, since=self._run.since
            )
            if self._run.stage is Stage.SETTLING:
                return False
            if self._run.begun:
                self._replanned_at = world.time
                if run.begin(world) is not None:
                    return False
            self._replace_run(world, run)
        self.chain = chain
        return True

    def _follow(self, world: World) -> Step | None:
        """Move the goal with an object that has left it.

        Return a stop, or None if the step can continue.
        """
        robot = self._library.robot
        call = self._run.call
        name = followed(call.top)
        if name is None or (self._run.begun and is_at_front(world, robot, name)):
            return None
        resting = at_rest(world, robot)
        if not has_left(resting, call, robot) or self._replanned_at == world.time:
            return None
        chain = self.chain.with_goal(self.index, at_object(call.goal, resting, name))
        if self.switch_to(world, chain):
            return None
        self._replace_run(
            world, self._new_run(chain, self.index, standing_first=True, since=self._run.since)
        )
        self.chain = chain
        return Step(STOP, Status.RUNNING, STOPPING)

    def _replace_run(self, world: World, run: StepRun) -> None:
        if self._run.begun and self._run.stage is not Stage.OVER:
            self.records.append(self._run.close(world, Ending.PREEMPTED, "another goal took over"))
        self._run = run

    @property
    def changed_at(self) -> float:
        """Time in s at which the last step ended, or was taken over from; -inf before."""
        times = [record.end.time for record in self.records]
        times += [passed.taken_over_at for passed in self._passed]
        return max(times, default=-math.inf)

    def _take_over(self, world: World, message: str) -> bool:
        """Let the next action take over before the goal is passed; return whether it can.

        The next one starts first, so that there is always one that cancels a server's goal.
        """
        if self.index + 1 >= len(self.chain):
            return False
        former = self._run
        run = self._new_run(self.chain, self.index + 1, since=world.time)
        if run.begin(world, former.action) is not None:
            return False
        record = former.close(world, Ending.SUCCEEDED, message, stopped=False)
        self._passed.append(PassedStep(record, self._library.robot))
        self._passed[-1].watch(world)
        self.index += 1
        self._run = run
        return True

    def _finish_passed(self, *, at_once: bool = False) -> int | None:
        """Record the steps whose goals were passed; return the first that was missed, or None.

        `at_once`: also those whose goals the robot has not left yet.
        """
        while self._passed and (self._passed[0].is_over or at_once):
            passed = self._passed.pop(0)
            self.records.append(passed.record())
            if passed.is_missed:
                reason = "an earlier goal was missed"
                for later in self._passed:
                    record = later.record()
                    self.records.append(
                        dataclasses.replace(record, ending=Ending.PREEMPTED, reason=reason)
                    )
                self._passed.clear()
                return passed.index
        return None

    def _stop_at(self, world: World, index: int) -> Step:
        """Drive to the goal of step `index` (from 0), which was missed, with a stop there."""
        self.index = index
        self.chain = self.chain.with_stop(index, world.robot.pose)
        self._replace_run(world, self._new_run(self.chain, index, standing_first=True))
        return Step(STOP, Status.RUNNING, STOPPING)

    def _after(self, world: World, status: Status) -> tuple[int, bool] | None:
        """Return the next step and whether the robot must first stand.

        None at the end of the chain.
        """
        if status is Status.SUCCEEDED:
            return (self.index + 1, False) if self.index + 1 < len(self.chain) else None
        top = self._run.call.top
        name = held_first(top) or (object_fetched_by(top) if self._run.begun else None)
        if (
            name is None
            or self.fetch_count >= self._fetches
            or not is_lost(world, self._library.robot, name)
        ):
            return None
        for index in range(self.index, -1, -1):  # back to the step that fetches the lost object
            if object_fetched_by(self.chain.calls[index].top) == name:
                self.fetch_count += 1
                return index, True
        return None

    def _new_run(
        self,
        chain: TopChain,
        index: int,
        *,
        standing_first: bool = False,
        since: float | None = None,
    ) -> StepRun:
        """Return a run of step `index` (from 0) of `chain`.

        `since` keeps the time limit of a former run.
        """
        top = chain.calls[index].top
        return StepRun(
            self._library,
            chain,
            index,
            self._time_limit,
            takeover=takeover_of(top, self._models.get(top.action), self._library.robot).dist,
            standing_first=standing_first,
            since=since,
        )


class StepRun:
    """One action of a chain with one goal, from its pre-condition to its post-condition.

    `action` is the action while it runs. `takeover` is the distance in m from a goal that is passed
    at which the next step can take over; `hands_over` is whether it shall do so now. `is_missed` is
    whether the action drives on by itself and has not passed the goal.

    `time_limit` (s) includes a stop before the action. It counts from `since` (s), which is that of
    the replaced run if only the goal has changed.
    """

    def __init__(
        self,
        library: TopLibrary,
        chain: TopChain,
        index: int,
        time_limit: float,
        *,
        takeover: float = 0.0,
        standing_first: bool = False,
        since: float | None = None,
    ) -> None:
        self.call = chain.calls[index]
        self.since = since
        self.stage = Stage.STANDING if standing_first else Stage.READY
        self._library = library
        self._chain = chain
        self._index = index
        self._time_limit = time_limit
        self._takeover = takeover
        self._approach = ClosestApproach()  # to the goal, of an action that drives on
        self.action: Action | None = None
        self.hands_over = self.is_missed = False
        self._start: World | None = None
        self._speeds: list[tuple[float, float]] = []  # times (s) and speeds (m/s) since the start
        self._settling = math.inf  # time in s since which the step waits for the action's effect

    @property
    def begun(self) -> bool:
        """Whether its action has started."""
        return self._start is not None

    def begin(self, world: World, former: Action | None = None) -> str | None:
        """Start the action, which may take over from a `former` one; return why it cannot start."""
        call = self.call
        robot = self._library.robot
        # where a rolling object stops
        checked = at_rest(world, robot) if followed(call.top) else world
        violations = call.top.pre.violations(state_of(checked, robot), goal_values(call.goal))
        if violations:
            return f"pre-condition of {call.top.name}: {'; '.join(violations)}"
        try:
            action = self._library.action(call.top)
            action.start(world, call.goal)
            if call.passing:
                following = (each.goal for each in self._chain.calls[self._index + 1 :])
                action.followed_by(goals_to_stop(following))
        except ActionError as error:
            return str(error)
        if former is not None:
            action.take_over(former)
        self.action = action
        self._start = world
        self.stage = Stage.ACTING
        self._speeds = [(world.time, world.robot.vx)]
        return None

    def step(self, world: World) -> Step:
        """Return the command of this tick; start the action if it has not started."""
        self.since = world.time if self.since is None else self.since
        step = self._next(world)
        if step.status is Status.RUNNING and world.time - self.since > self._time_limit:
            return Step(
                STOP, Status.FAILED, f"{self.call.top.name} took longer than {self._time_limit:g} s"
            )
        return step

    def _next(self, world: World) -> Step:
        if self.begun:
            self._speeds.append((world.time, world.robot.vx))
        if self.stage is Stage.STANDING:
            if not world.robot.is_standing:
                return Step(STOP, Status.RUNNING, STOPPING)
            self.stage = Stage.READY
        fault = self.begin(world) if self.stage is Stage.READY else None
        if fault is not None:
            return Step(STOP, Status.FAILED, fault)
        if self.action is None:  # SETTLING
            return self._confirmed(
                world, Step(STOP, Status.SUCCEEDED, f"{self.call.top.name} has settled")
            )
        if self.call.passing and self._can_hand_over(world):
            self.hands_over = True
            return Step(None, Status.SUCCEEDED, f"{self.call.top.name} passed its goal")
        drives_on = self.action.drives_on
        done = self.action.step(world)
        if drives_on and (done.status is Status.SUCCEEDED or self._leaves_goal(world)):
            self.is_missed = True
            return Step(None, Status.FAILED, self.call.top.failure(self._unmet(world)))
        return self._confirmed(world, done)

    def _can_hand_over(self, world: World) -> bool:
        """Return whether the next step can take over from one that passes its goal."""
        distance = _distance(world, self.call, self._library.robot)
        return distance <= self._takeover or not self._unmet(world)

    def _leaves_goal(self, world: World) -> bool:
        """Return whether the robot has come near the goal, and now leaves it."""
        distance = _distance(world, self.call, self._library.robot)
        return self._approach.leaves(distance) and self._approach.distance <= _NEAR

    def continue_to_goal(self, world: World) -> bool:
        """Allow no takeover before the goal is reached; return whether it is not reached yet."""
        self.hands_over = False
        self._takeover = 0.0
        return bool(self._unmet(world))

    def _confirmed(self, world: World, step: Step) -> Step:
        """Return `step`; a failure or a stop if it succeeded without its post-condition."""
        if step.status is not Status.SUCCEEDED:
            return step
        top = self.call.top
        unmet = self._unmet(world)
        if not unmet:
            return step
        if self.action is not None and self.action.is_before_result(world):
            awaited = f"{top.name} waits for a state after its end: {'; '.join(unmet)}"
            return Step(None, Status.RUNNING, awaited)
        self._settling = min(self._settling, world.time)
        if top.may_settle(world) and world.time - self._settling < top.settles:
            self.end(step.message)
            self.stage = Stage.SETTLING
            return Step(STOP, Status.RUNNING, f"{top.name} settles: {'; '.join(unmet)}")
        return Step(STOP, Status.FAILED, top.failure(unmet))

    def _unmet(self, world: World) -> list[str]:
        return self.call.top.unmet(world, self.call.goal, self._library.robot)

    def end(self, reason: str) -> None:
        """End the step and its action; see `Action.end`."""
        if self.action is not None:
            self.action.end(reason)
        self.action = None
        self.stage = Stage.OVER

    def close(
        self, world: World, ending: Ending, reason: str, *, stopped: bool = True
    ) -> ActionRecord:
        """End the step in the state `world`; return its record."""
        self.end(reason)
        robot = self._library.robot
        goal = self.call.goal.robot_pose(robot)
        held = kept(self.call.top) if self.begun else held_first(self.call.top)
        lost = ending is Ending.FAILED and held is not None and is_lost(world, robot, held)
        start = self._start or world
        parts = DriveParts()
        if self._speeds:
            times, speeds = np.array(self._speeds).T
            parts = parts_of_drive(times - start.time, speeds, world.time - start.time)
        return ActionRecord(
            index=self._index,
            chain=self._chain,
            start=start,
            end=world,
            ending=ending,
            reason=reason,
            position_error=_distance(world, self.call, robot),
            heading_error=abs(world.robot.pose.relative(goal).yaw),
            parts=parts,
            lost=held if lost else None,
            stopped=stopped,
        )


def _distance(world: World, call: TopCall, robot: Robot) -> float:
    """Return the distance in m between the robot and the goal of a step."""
    return world.robot.pose.distance(call.goal.robot_pose(robot))
