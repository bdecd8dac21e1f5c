"""The state machine of a goal: each transition of its table is taken, and no other one."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from carried import CALL, CARRY_CALL, Ledger, Sent

from ator_ros.actions.base import Status
from ator_ros.execution.chain_executor import Ending
from ator_ros.execution.supervisor import TRANSITIONS, Event, Phase, Signal
from ator_ros.tops.chain import TopChain

Cause = Callable[[Ledger, Sent], None]


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


CAUSES: dict[Event, Cause] = {
    Signal.READY: lambda _, goal: goal.tick(),
    Signal.ASKED: lambda _, goal: goal.tick(),
    Signal.ANSWERED: lambda _, goal: goal.execution.unrefined("no better chain"),
    Signal.STOOD: lambda _, goal: goal.tick(),
    Signal.NO_ODOMETRY: lambda _, goal: goal.execution.watch(goal.now + 1.0),
    Signal.DROPPED: lambda _, goal: goal.execution.drop(),
    **{ending: ended_by(ending) for ending in (Ending.CANCELED, Ending.PREEMPTED, Ending.SHUTDOWN)},
    Ending.INPUT_LOST: lose_odometry,
    Ending.BASE_FAULT: lambda _, goal: goal.execution.base_fault("it does not move"),
    Ending.REFUSED: lambda _, goal: goal.tick(mark=5.0),
    Ending.SUCCEEDED: finish(Status.SUCCEEDED),
    Ending.FAILED: finish(Status.FAILED),
    Ending.OBJECT_LOST: lose_the_cup,
    Ending.OUT_OF_BOUNDS: lambda _, goal: goal.tick(x=9.0),
}


@pytest.mark.parametrize(("phase", "event"), TRANSITIONS, ids=lambda one: one.name)
def test_each_transition_of_the_table_is_taken_and_can_be_followed_by_the_end(
    phase: Phase, event: Event
) -> None:
    ledger = Ledger()
    goal = goal_in(phase, ledger, event)
    CAUSES[event](ledger, goal)
    after = goal.execution.phase
    if isinstance(event, Ending):  # a robot that stands, or whose state is not known, has nothing to wait for
        assert after in (TRANSITIONS[phase, event], Phase.ENDED)
        assert goal.execution.ending is event
    else:
        assert after is TRANSITIONS[phase, event]
    goal.execution.end(Ending.CANCELED, "the end")
    for _ in range(2):
        goal.tick()
    assert goal.execution.phase is Phase.ENDED
    assert len(ledger.starts) == len(ledger.ends)
