"""A goal and its action end once, for any ending and phase."""

import pytest
from carried import CALL, ActionLog, DrivenGoal

from ator_ros.actions.base import Status
from ator_ros.execution.chain_executor import Ending
from ator_ros.execution.supervisor import Phase
from ator_ros.tops.chain import TopChain


def goal_in(phase: Phase, actions: ActionLog) -> DrivenGoal:
    goal = DrivenGoal(actions, TopChain((CALL,)), refine=phase is Phase.REFINING)
    ticks = {Phase.WAITING: 0, Phase.REFINING: 1}.get(phase, 2)
    for _ in range(ticks):
        goal.tick()
    if phase is Phase.STOPPING:
        actions.outcome = Status.SUCCEEDED
        goal.tick(v=0.5)
    assert goal.execution.phase is phase
    return goal


@pytest.mark.parametrize("cause", [Ending.CANCELED, Ending.INPUT_LOST, Ending.BASE_FAULT, None])
@pytest.mark.parametrize("phase", [Phase.WAITING, Phase.REFINING, Phase.EXECUTING, Phase.STOPPING])
def test_a_goal_may_end_in_each_phase(phase: Phase, cause: Ending | None) -> None:
    actions = ActionLog()
    goal = goal_in(phase, actions)
    execution = goal.execution
    if cause is Ending.INPUT_LOST:
        execution.watch(goal.now + 3.0)
    elif cause is Ending.BASE_FAULT:
        execution.base_fault("it does not move")
    elif cause is not None:
        execution.end(cause, "asked for")
    expected = cause
    if phase is Phase.STOPPING and cause is not Ending.BASE_FAULT:
        expected = Ending.SUCCEEDED  # it had already ended
    assert execution.ending is expected
    execution.end(Ending.SHUTDOWN, "the end")
    execution.drop()
    assert execution.phase is Phase.ENDED
    assert execution.ending is (expected or Ending.SHUTDOWN)
    assert len(actions.starts) == len(actions.ends)
