"""What an execution came to, as messages."""

from __future__ import annotations

import dataclasses
import math

from ator_interfaces.msg import ActionPerformance, ChainPerformance, Outcome, Performance
from ator_ros.execution.execution import Execution
from ator_ros.execution.phases import Ending, Phase
from ator_ros.execution.step_run import ActionRecord
from ator_ros.nodes.messages import call_of, chain_of, chain_performance_of, performance_of, situation_of
from ator_ros.world.state import World

_BROKEN_OFF = (Ending.CANCELED, Ending.PREEMPTED, Ending.SHUTDOWN)


def outcome_of(ending: Ending, reason: str) -> Outcome:
    """Write how something ended."""
    return Outcome(code=ending.value, reason=reason)


def action_record_of(
    record: ActionRecord,
    execution: Execution,
    *,
    chain_id: str,
    action_set: str,
    frame: str,
) -> ActionPerformance:
    """Return how one action of a chain went, from its record."""
    call = dataclasses.replace(execution.chain.calls[record.index], goal=record.goal)
    message = ActionPerformance(
        chain_id=chain_id,
        step=record.index,
        steps=len(execution.chain),
        action=record.action,
        action_set=action_set,
        call=call_of(call, frame=frame),
        start=situation_of(record.start, frame=frame),
        end=situation_of(record.end, frame=frame),
        predicted=performance_of(None if record.predicted is None else record.predicted()),
        actual=actual(record.duration, record.ending, record.position_error),
        heading_error=float(record.heading_error),
        outcome=outcome_of(record.ending, record.reason),
    )
    message.header = message.end.header
    return message


def chain_record_of(
    execution: Execution,
    actions: list[ActionPerformance],
    *,
    end: World,
    chain_id: str,
    action_set: str,
    frame: str,
) -> ChainPerformance:
    """Write how the execution of a chain went; `end` is the last state known."""
    ending = execution.ending or Ending.FAILED
    message = _chain_of(execution, actions, end, chain_id, action_set, frame)
    message.predicted = chain_performance_of(execution.predicted)
    message.actual = actual(execution.elapsed, ending)
    message.outcome = outcome_of(ending, execution.reason)
    return message


def chain_so_far_of(
    execution: Execution,
    actions: list[ActionPerformance],
    *,
    world: World,
    chain_id: str,
    action_set: str,
    frame: str,
) -> ChainPerformance:
    """Write how the execution of a chain goes, cheaply; `world` is the last state known."""
    waits = execution.phase in (Phase.WAITING, Phase.REFINING)
    ending, reason = execution.ending, execution.reason
    message = _chain_of(execution, actions, world, chain_id, action_set, frame)
    message.predicted = performance_of()
    message.actual = performance_of({} if waits else {"duration": execution.elapsed})
    message.outcome = Outcome(reason=reason) if ending is None else outcome_of(ending, reason)
    return message


def _chain_of(
    execution: Execution,
    actions: list[ActionPerformance],
    world: World,
    chain_id: str,
    action_set: str,
    frame: str,
) -> ChainPerformance:
    """Write what is known of a chain whether or not it has ended; `world` is the last state known."""
    message = ChainPerformance(
        chain_id=chain_id,
        chain=chain_of(execution.chain, action_set=action_set, frame=frame),
        start=situation_of(execution.start or world, frame=frame),
        refined=execution.refined,
        refinement=execution.refinement,
        fetched=execution.fetched,
        refined_again=execution.refined_again,
        actions=actions,
    )
    message.header = situation_of(world, frame=frame).header
    return message


def actual(duration: float, ending: Ending, accuracy: float = math.nan) -> Performance:
    """Write an actual performance; whether it would have succeeded is not known where it was broken off."""
    success = math.nan if ending in _BROKEN_OFF else float(ending is Ending.SUCCEEDED)
    return performance_of({"duration": duration, "spread": 0.0, "success": success, "accuracy": accuracy})
