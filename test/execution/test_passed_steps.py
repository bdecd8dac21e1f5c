"""Chains whose steps pass their goals: the next action takes over while the robot drives."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import pytest

from ator_ros.actions.base import Action, ActionError, Goal, Status, Step
from ator_ros.actions.goal_variables import STOP, STOPS
from ator_ros.bases.description import load_robot
from ator_ros.execution.chain_executor import ChainExecutor, Ending
from ator_ros.geometry import Pose
from ator_ros.performance.model import Passing
from ator_ros.tops.chain import Top, TopCall, TopChain
from ator_ros.tops.conditions import Condition, Term
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import STOP as STANDING
from ator_ros.world.state import RobotState, World

ROBOT = load_robot()
POST = Condition((Term("robot.x", "goal.x", 0.3), Term("robot.yaw", "goal.yaw", 0.3)))
VISIT = Top("visit", "drive", Condition(), POST)


class Driver(Action):
    """An action that another program executes; `events` has what happened to all of them."""

    name = "drive"

    def __init__(self, events: list[str], unreachable: float) -> None:
        super().__init__(ROBOT)
        self._events = events
        self._unreachable = unreachable
        self._at = 0.0

    def start(self, world: World, goal: Goal) -> None:
        self._at = goal.pose.x
        if self._at == self._unreachable:
            raise ActionError("no way")
        self._events.append(f"start {self._at:g}")

    def take_over(self, former: Action) -> None:
        assert isinstance(former, Driver)
        self._events.append(f"{self._at:g} takes over from {former._at:g}")

    def step(self, world: World) -> Step:
        arrived = abs(world.robot.pose.x - self._at) < 0.1
        return Step(None, Status.SUCCEEDED if arrived else Status.RUNNING, "driving")

    def end(self, reason: str) -> None:
        self._events.append(f"end {self._at:g}")


class Nearer:
    """A model of an action that comes 0.4 m nearer to a goal after the next one has taken over."""

    arrival = None
    used_variables: frozenset[str] = frozenset()
    passing = Passing(nearer=0.4, speed=0.5)

    def predict(self, *_: Any) -> Any:
        raise NotImplementedError


def executor(
    *stops: tuple[float, bool],
    unreachable: float = 9.0,
    models: Mapping[str, Any] | None = None,
    driver: type[Driver] = Driver,
    top: Top = VISIT,
) -> tuple[Any, list[str]]:
    """Return the executor of a chain of places (m) with whether the robot stops there."""
    events: list[str] = []
    library = TopLibrary(
        ROBOT,
        "default",
        tops=(top,),
        actions={"drive": lambda _: driver(events, unreachable)},
        goal_variables={"drive": (STOPS,)},
    )
    calls = [TopCall(top, Goal(Pose(x, 0.0, 0.0), values={STOP: float(stop)})) for x, stop in stops]
    return ChainExecutor(library, TopChain(tuple(calls)), models=models or {}), events


def state(time: float, x: float, yaw: float = 0.0) -> World:
    return World(time, RobotState(Pose(x, 0.0, yaw), 0.6))


def test_a_step_is_passed_within_its_tolerance_in_any_heading() -> None:
    run, events = executor((1.0, False), (2.0, True))
    run.step(state(0.0, 0.0))
    run.step(state(1.0, 0.65, 2.0))
    assert events == ["start 1"]
    step = run.step(state(1.1, 0.75, 2.0))
    assert (step.command, step.status) == (None, Status.RUNNING)
    assert events == ["start 1", "start 2", "2 takes over from 1", "end 1"]
    assert run.index == 1
    run.step(state(1.5, 0.98))
    assert not run.records  # it may yet come nearer
    run.step(state(1.7, 1.15))
    (record,) = run.records
    assert (record.ending, record.stopped) == (Ending.SUCCEEDED, False)
    assert record.duration == pytest.approx(1.1)
    assert record.position_error == pytest.approx(0.02)
    assert run.step(state(3.0, 1.95)).status is Status.SUCCEEDED
    assert run.records[1].stopped
    assert run.records[1].start.robot.vx == 0.6


def test_a_robot_that_stops_within_the_tolerance_of_a_step_that_passes_has_stopped() -> None:
    run, events = executor((1.0, False), (2.0, True))
    run.step(state(0.0, 0.95))
    assert events[-1] == "end 1"
    run.interrupt(state(0.1, 0.95), Ending.CANCELED, "canceled")
    assert run.records[0].stopped is False  # the position was enough, in its first tick


def test_a_step_that_cannot_start_ends_the_chain_and_the_passed_action() -> None:
    run, events = executor((1.0, False), (2.0, True), unreachable=2.0)
    run.step(state(0.0, 0.0))
    step = run.step(state(1.0, 0.8))
    assert (step.status, step.message) == (Status.FAILED, "no way")
    assert events == ["start 1", "end 1"]
    assert [record.ending for record in run.records] == [Ending.SUCCEEDED, Ending.FAILED]


CALM = dataclasses.replace(VISIT, pre=Condition((Term("robot.yaw", 0.0, 1.0),)))


def test_the_pre_condition_of_the_next_step_must_hold_where_the_goal_is_passed() -> None:
    run, events = executor((1.0, False), (2.0, True), top=CALM)
    run.step(state(0.0, 0.0))
    step = run.step(state(1.0, 0.8, 2.0))
    assert step.status is Status.FAILED
    assert step.message.startswith("pre-condition of visit: expected robot.yaw")
    assert step.command == STANDING
    assert events == ["start 1", "end 1"]
    assert [(record.index, record.ending) for record in run.records] == [
        (0, Ending.SUCCEEDED), (1, Ending.FAILED),
    ]  # fmt: skip


def test_a_step_that_cannot_take_over_yet_does_so_at_the_goal() -> None:
    run, events = executor((1.0, False), (2.0, True), top=CALM, models={"drive": Nearer()})
    run.step(state(0.0, 0.0))
    step = run.step(state(0.6, 0.4, 2.0))
    assert (step.command, step.status) == (None, Status.RUNNING)
    assert events == ["start 1"]
    run.step(state(0.8, 0.6, 0.0))  # not within its tolerance
    assert events == ["start 1"]
    run.step(state(1.0, 0.75, 0.0))
    assert events[-2:] == ["2 takes over from 1", "end 1"]


def test_an_interruption_ends_the_action_that_drives() -> None:
    run, events = executor((1.0, False), (2.0, True))
    run.step(state(0.0, 0.0))
    run.step(state(1.0, 0.8))
    run.interrupt(state(1.1, 0.9), Ending.CANCELED, "canceled")
    assert events[-1] == "end 2"
    assert run.records[-1].ending is Ending.CANCELED


def test_an_interruption_ends_the_leg_to_a_goal_that_is_not_passed_yet() -> None:
    run, events = executor((1.0, False), (2.0, True), models={"drive": Nearer()})
    run.step(state(0.0, 0.0))
    run.step(state(0.6, 0.4))
    run.interrupt(state(0.7, 0.45), Ending.PREEMPTED, "a newer goal took over")
    assert [(record.index, record.ending) for record in run.records] == [
        (0, Ending.PREEMPTED), (1, Ending.PREEMPTED),
    ]  # fmt: skip
    assert events[-1] == "end 2"


def test_the_next_step_takes_over_as_far_before_a_goal_as_it_is_passed_within_the_tolerance() -> (
    None
):
    run, events = executor((1.0, False), (2.0, True), models={"drive": Nearer()})
    run.step(state(0.0, 0.0))
    run.step(state(0.5, 0.29))
    assert events == ["start 1"]
    run.step(state(0.6, 0.31))  # 0.3 m of tolerance and 0.4 m that it comes nearer
    assert events[-1] == "end 1"
    run.step(state(1.0, 0.75))
    run.step(state(1.5, 0.6))
    (record,) = run.records
    assert record.ending is Ending.SUCCEEDED
    assert record.end.robot.pose.x == 0.31
    assert record.position_error == pytest.approx(0.25)


def test_a_goal_that_is_missed_is_driven_to_with_a_stop() -> None:
    run, events = executor((1.0, False), (2.0, False), (3.0, True), models={"drive": Nearer()})
    run.step(state(0.0, 0.0))
    run.step(state(0.6, 0.4))
    run.step(state(1.0, 0.65))  # 5 cm too far
    step = run.step(state(1.2, 0.5))
    assert step.status is Status.RUNNING
    assert step.command == STANDING
    assert events[-1] == "end 2"
    missed, given_up = run.records
    assert (missed.index, missed.ending, missed.stopped) == (0, Ending.FAILED, False)
    assert missed.position_error == pytest.approx(0.35)
    assert "robot.x" in missed.reason
    assert (given_up.index, given_up.ending) == (1, Ending.PREEMPTED)
    assert run.index == 0
    assert [call.passing for call in run.chain.calls] == [False, True, False]
    run.step(World(1.5, RobotState(Pose(0.5, 0.0, 0.0), 0.0)))
    assert events[-1] == "start 1"
    run.step(state(2.0, 0.95))
    assert run.records[-1].stopped
    assert run.index == 1


def test_a_goal_counts_as_missed_if_the_last_step_ends_without_it() -> None:
    run, _ = executor((1.0, False), (1.3, True), models={"drive": Nearer()})
    run.step(state(0.0, 0.0))
    run.step(state(0.6, 0.31))
    run.step(World(1.0, RobotState(Pose(1.31, 0.0, 0.0), 0.6)))  # 1 cm beyond the tolerance
    assert run.index == 0
    assert [record.ending for record in run.records] == [Ending.FAILED, Ending.SUCCEEDED]


class Through(Driver):
    """A driver that drives through its goal and those that follow."""

    _drives_on = False

    def followed_by(self, goals: Sequence[Goal]) -> None:
        self._drives_on = True
        self._events.append(f"then {', '.join(f'{goal.pose.x:g}' for goal in goals)}")

    @property
    def drives_on(self) -> bool:
        return self._drives_on


def test_an_action_gets_the_goals_up_to_the_next_stop() -> None:
    run, events = executor((1.0, False), (2.0, False), (3.0, True), (4.0, True), driver=Through)
    run.step(state(0.0, 0.0))
    assert events == ["start 1", "then 2, 3"]
    run.step(state(1.0, 0.9))
    assert events[2:] == ["start 2", "then 3", "2 takes over from 1", "end 1"]
    run.step(state(2.0, 1.9))
    assert events[6:] == ["start 3", "3 takes over from 2", "end 2"]


@pytest.mark.parametrize(("nearest", "then"), [(0.5, 0.35), (1.5, 1.65), (0.0, 9.0)])
def test_a_goal_is_missed_where_the_action_leaves_it_or_ends(nearest: float, then: float) -> None:
    run, events = executor((1.0, False), (2.0, False), (9.0, True), driver=Through)
    run.step(state(0.0, 0.0))
    run.step(state(0.5, nearest))
    assert run.index == 0
    step = run.step(state(1.0, then))
    if then == 9.0:
        step = run.step(state(1.1, 1.05))
    assert step.status is Status.RUNNING
    assert step.command == STANDING
    assert events[-1] == "end 1"
    (record,) = run.records
    assert (record.index, record.ending, record.stopped) == (0, Ending.FAILED, True)
    assert [call.passing for call in run.chain.calls] == [False, True, False]
