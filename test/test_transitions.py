"""The state machine of a goal: each transition of its table is taken, and no other one."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import pytest
from carried import CALL, CARRY_CALL, ROLL, Ledger, Sent

from ator_ros.actions.base import Goal, Status
from ator_ros.execution.phases import Ending, Phase
from ator_ros.execution.step_run import StepRun
from ator_ros.execution.transitions import (
    ENDINGS,
    STAGES,
    TRANSITIONS,
    Event,
    GoalCourse,
    Signal,
    Stage,
    TransitionError,
)
from ator_ros.geometry import Pose
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.world.state import ObjectState, RobotState, World

Cause = Callable[[Ledger, Sent], None]


@pytest.fixture
def taken(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Phase, Event, Phase]]:
    """Return the transitions that goals take, as they do."""
    all_of_them: list[tuple[Phase, Event, Phase]] = []
    take = GoalCourse.take

    def noted(course: GoalCourse, event: Event) -> None:
        before = course.phase
        take(course, event)
        all_of_them.append((before, event, course.phase))

    monkeypatch.setattr(GoalCourse, "take", noted)
    return all_of_them


def goal_in(phase: Phase, ledger: Ledger, event: Event) -> Sent:
    """Return a goal in `phase` that is going to see `event`."""
    refine = phase is Phase.REFINING or event in (Signal.ASKED, Signal.ANSWERED)
    call = CARRY_CALL if event is Ending.OBJECT_LOST else CALL
    goal = Sent(ledger, TopChain((call,)), refine=refine)
    if phase is Phase.WAITING:
        return goal
    goal.tick()
    if phase is Phase.EXECUTING:
        if refine:
            goal.execution.unrefined("the first answer")
        goal.tick()
    if phase is Phase.STOPPING:
        goal.tick()
        ledger.outcome = Status.SUCCEEDED
        goal.tick(v=0.5)
    assert goal.execution.phase is phase
    return goal


def ended_by(ending: Ending) -> Cause:
    return lambda _, goal: goal.execution.end(ending, "asked for")


def finish(status: Status) -> Cause:
    def act(ledger: Ledger, goal: Sent) -> None:
        ledger.outcome = status
        goal.tick()

    return act


def lose_the_cup(ledger: Ledger, goal: Sent) -> None:
    ledger.outcome = Status.FAILED
    goal.tick(cup=1.0)


def lose_odometry(_: Ledger, goal: Sent) -> None:
    """Let so much time pass that odometry counts as lost, but refinement not yet as silent."""
    goal.execution.watch(goal.now + (3.0 if goal.execution.phase is Phase.WAITING else 0.4))


def answer(_: Ledger, goal: Sent) -> None:
    if goal.execution.question is None:  # refinement is asked again while the robot drives
        goal.execution._refining.ask(goal.execution.start, goal.execution.chain, goal.now)
    goal.execution.unrefined("no better chain")


CAUSES: dict[Event, Cause] = {
    Signal.READY: lambda _, goal: goal.tick(),
    Signal.ASKED: lambda _, goal: goal.tick(),
    Signal.ANSWERED: answer,
    Signal.STOOD: lambda _, goal: goal.tick(),
    Signal.SILENT: lambda _, goal: goal.execution.watch(goal.now + 1.0),
    Signal.DROPPED: lambda _, goal: goal.execution.drop(),
    **{ending: ended_by(ending) for ending in (Ending.CANCELED, Ending.PREEMPTED, Ending.SHUTDOWN)},
    Ending.INPUT_LOST: lose_odometry,
    Ending.BASE_FAULT: lambda _, goal: goal.execution.misbehaved("it does not move"),
    Ending.REFUSED: lambda _, goal: goal.tick(mark=5.0),
    Ending.SUCCEEDED: finish(Status.SUCCEEDED),
    Ending.FAILED: finish(Status.FAILED),
    Ending.OBJECT_LOST: lose_the_cup,
    Ending.OUT_OF_BOUNDS: lambda _, goal: goal.tick(x=9.0),
}


@pytest.mark.parametrize(("phase", "event"), TRANSITIONS, ids=lambda one: one.name)
def test_each_transition_of_the_table_is_taken(
    phase: Phase, event: Event, taken: list[tuple[Phase, Event, Phase]]
) -> None:
    ledger = Ledger()
    goal = goal_in(phase, ledger, event)
    before = len(taken)
    CAUSES[event](ledger, goal)
    assert taken[before] == (phase, event, TRANSITIONS[phase, event])
    if isinstance(event, Ending):
        assert goal.execution.ending is event


@pytest.mark.parametrize(("phase", "event"), TRANSITIONS, ids=lambda one: one.name)
def test_from_everywhere_the_goal_can_end_and_its_action_is_over(phase: Phase, event: Event) -> None:
    ledger = Ledger()
    goal = goal_in(phase, ledger, event)
    CAUSES[event](ledger, goal)
    goal.execution.end(Ending.CANCELED, "the end")
    for _ in range(2):
        goal.tick()
    assert goal.execution.phase is Phase.ENDED
    assert len(ledger.starts) == len(ledger.ends)


def test_no_other_transition_can_be_taken() -> None:
    for phase, event in itertools.product(Phase, (*Signal, *Ending)):
        if (phase, event) not in TRANSITIONS:
            course = GoalCourse()
            course._phase = phase
            with pytest.raises(TransitionError, match=f"phase {phase.name}: .* got {event.name}"):
                course.take(event)
            assert course.phase is phase


def test_every_ending_can_come_and_nothing_follows_the_end() -> None:
    assert {ending for endings in ENDINGS.values() for ending in endings} == set(Ending)
    assert not [phase for phase, _ in TRANSITIONS if phase is Phase.ENDED]
    reached, new = set(), {Phase.WAITING}
    while new:
        reached |= new
        new = {TRANSITIONS[phase, event] for phase, event in TRANSITIONS if phase in reached} - reached
    assert reached == set(Phase)


def world_at(time: float, *, v: float = 0.0, rolling: float = 0.5) -> World:
    return World(time, RobotState(Pose(0.0, 0.0, 0.0), v), {"mark": ObjectState(2.0, 0.0, rolling)})


def step_in(stage: Stage, ledger: Ledger) -> StepRun:
    """Return a step that is in `stage` and has taken 0.1 s."""
    call = TopCall(ROLL, Goal(Pose(3.0, 0.0, 0.0)))
    step = StepRun(ledger.library(), 0, call, time_limit=5.0, standing_first=stage is Stage.STANDING)
    if stage is Stage.STANDING:
        step.step(world_at(0.0, v=0.5))
    if stage in (Stage.ACTING, Stage.SETTLING):
        step.step(world_at(0.0))
    if stage is Stage.SETTLING:
        ledger.outcome = Status.SUCCEEDED
        step.step(world_at(0.05))
    if stage is Stage.OVER:
        step.close(world_at(0.0), Ending.FAILED, "over")
    assert step._stage is stage
    return step


def settle(ledger: Ledger, step: StepRun) -> None:
    ledger.outcome = Status.SUCCEEDED
    step.step(world_at(0.1))


STEPS: dict[tuple[Stage, Stage], Callable[[Ledger, StepRun], object]] = {
    (Stage.STANDING, Stage.READY): lambda ledger, step: _unable(ledger, step),
    (Stage.STANDING, Stage.OVER): lambda _, step: _fail(step, world_at(6.0, v=0.5)),
    (Stage.READY, Stage.ACTING): lambda _, step: step.step(world_at(0.1)),
    (Stage.READY, Stage.OVER): lambda ledger, step: _refuse(ledger, step),
    (Stage.ACTING, Stage.SETTLING): settle,
    (Stage.ACTING, Stage.OVER): lambda _, step: _fail(step, world_at(6.0)),
    (Stage.SETTLING, Stage.OVER): lambda _, step: _fail(step, world_at(0.2, rolling=0.0)),
}


def _fail(step: StepRun, world: World) -> None:
    """Let a tick pass in which the step fails, and close it."""
    assert step.step(world).status is Status.FAILED
    step.close(world, Ending.FAILED, "over")


def _refuse(ledger: Ledger, step: StepRun) -> None:
    ledger.refuses = True
    _fail(step, world_at(0.1))


def _unable(ledger: Ledger, step: StepRun) -> None:
    """Let a tick pass in which the action cannot start."""
    ledger.refuses = True
    step.step(world_at(0.1))


def test_the_stages_of_a_step_are_known() -> None:
    assert set(STEPS) == {(stage, after) for stage, following in STAGES.items() for after in following}


@pytest.mark.parametrize(("stage", "after"), STEPS, ids=lambda one: one.name)
def test_a_step_goes_from_stage_to_stage_and_its_action_ends_when_it_leaves_acting(
    stage: Stage, after: Stage
) -> None:
    ledger = Ledger()
    step = step_in(stage, ledger)
    STEPS[stage, after](ledger, step)
    assert step._stage is after
    assert len(ledger.ends) == len(ledger.starts) - (after is Stage.ACTING)


def test_a_step_that_is_over_stays_so() -> None:
    step = step_in(Stage.OVER, Ledger())
    with pytest.raises(TransitionError, match="stage OVER: expected another stage, got OVER"):
        step.end("once more")
