"""The chain executor: calls the action of each TOP in turn (paper, section 2.2), tick by tick."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ator_ros.actions.base import Action, ActionError, Goal, Status, Step
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.state import goal_variables, state_of
from ator_ros.world import STOP, Command, World

Predict = Callable[[World, TopCall], Any]


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
        What it was to reach.
    duration : float
        Time it took in s.
    outcome : Status
        SUCCEEDED or FAILED.
    reason : str
        A sentence on how it ended.
    position_error, heading_error : float
        Distance from the goal at the end in m, difference of headings in rad.
    predicted : object
        What the performance model predicted at the start; None without one.
    """

    index: int
    top: str
    action: str
    start: World
    goal: Goal
    duration: float
    outcome: Status
    reason: str
    position_error: float
    heading_error: float
    predicted: Any = None


@dataclass(frozen=True, slots=True)
class ChainStep:
    """One tick of a chain: command, status, step (from 0), a sentence, time since the start in s."""

    command: Command
    status: Status
    index: int
    message: str
    elapsed: float


class ChainExecutor:
    """Executes a TOP chain.

    Parameters
    ----------
    library : TopLibrary
        Gives the actions.
    chain : TopChain
        What to execute; each pre-condition is checked when its turn comes.
    time_limit : float
        Time in s that each action may take.
    predict : callable, optional
        Predicts the performance of a step from the world in which it starts, for the record.
    """

    def __init__(
        self,
        library: TopLibrary,
        chain: TopChain,
        *,
        time_limit: float = 30.0,
        predict: Predict | None = None,
    ) -> None:
        self._library = library
        self._chain = chain
        self._time_limit = time_limit
        self._predict = predict
        self._action: Action | None = None
        self._index = 0
        self._began: float | None = None
        self._start: World | None = None
        self._predicted: Any = None
        self.records: list[ActionRecord] = []

    def step(self, world: World) -> ChainStep:
        """Give the command of this tick; an action that ends hands over to the next in the same tick."""
        if self._began is None:
            self._began = world.time
        while True:
            step = self._step_action(world)
            if step.status is Status.RUNNING:
                return self._told(world, step)
            self._record(world, step)
            last = self._index + 1 == len(self._chain)
            if step.status is Status.FAILED or last:
                return self._told(world, Step(STOP, step.status, step.message))
            self._action, self._index = None, self._index + 1

    @property
    def chain(self) -> TopChain:
        """The chain as it is executed."""
        return self._chain

    @property
    def index(self) -> int:
        """The step of the chain that is being executed, from 0."""
        return self._index

    def _told(self, world: World, step: Step) -> ChainStep:
        assert self._began is not None
        return ChainStep(step.command, step.status, self._index, step.message, world.time - self._began)

    def _step_action(self, world: World) -> Step:
        call = self._chain.calls[self._index]
        if self._action is None:
            self._start = world
            violations = call.top.pre.violations(
                state_of(world, self._library.robot), goal_variables(call.goal)
            )
            if violations:
                return Step(STOP, Status.FAILED, f"pre-condition of {call.top.name}: {'; '.join(violations)}")
            action = self._library.action(call.top)
            try:
                action.start(world, call.goal)
            except ActionError as error:
                return Step(STOP, Status.FAILED, str(error))
            self._action = action
            self._predicted = None if self._predict is None else self._predict(world, call)
        step = self._action.step(world)
        assert self._start is not None
        if step.status is Status.RUNNING and world.time - self._start.time > self._time_limit:
            return Step(STOP, Status.FAILED, f"{call.top.name} took longer than {self._time_limit:g} s")
        return self._confirmed(world, call, step)

    def _confirmed(self, world: World, call: TopCall, step: Step) -> Step:
        """Believe in success only when the post-condition holds."""
        if step.status is not Status.SUCCEEDED:
            return step
        goal = goal_variables(call.goal)
        violations = call.top.post.violations(state_of(world, self._library.robot), goal)
        if not violations:
            return step
        return Step(STOP, Status.FAILED, f"post-condition of {call.top.name}: {'; '.join(violations)}")

    def _record(self, world: World, step: Step) -> None:
        call, start = self._chain.calls[self._index], self._start
        assert start is not None
        pose, goal = world.robot.pose, call.goal.robot_pose(self._library.robot)
        self.records.append(
            ActionRecord(
                self._index,
                call.top.name,
                call.top.action,
                start,
                call.goal,
                world.time - start.time,
                step.status,
                step.message,
                pose.distance(goal),
                abs(pose.relative(goal).yaw),
                self._predicted,
            )
        )
        self._predicted = None
