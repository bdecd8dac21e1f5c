"""Executed chains rebuilt from the executor's records, from a topic or a recording."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from ator_ros.execution.chain_executor import Ending
from ator_ros.experience.records import SUCCEEDED
from ator_ros.geometry import Pose
from ator_ros.printable import printable
from ator_ros.viewing.history import Driven
from ator_ros.world.messages import object_from, pose_from, seconds_from

_OUTCOMES = {ending.value: ending.name.lower().replace("_", " ") for ending in Ending}
_LONGEST = 60
_LONGEST_REASON = 300


@dataclass(frozen=True, slots=True)
class RecordedStep:
    """An action of an executed chain.

    Attributes
    ----------
    number : int
        Which step of the chain it is, from 0.
    top : str
        Name of its TOP.
    goal : Pose
        Its subgoal.
    began, ended : float
        Stamps in s.
    predicted, actual : float
        Durations in s; NaN without a model, or where the action did not succeed.
    """

    number: int
    top: str
    goal: Pose
    began: float
    ended: float
    predicted: float
    actual: float


@dataclass(frozen=True, slots=True)
class RecordedChain:
    """An executed chain.

    Attributes
    ----------
    start : Pose
        Where the robot was.
    goals : tuple of Pose
        Its subgoals, those included that were not reached.
    steps : tuple of RecordedStep
        The executed actions in order; steps may repeat.
    began : float
        Stamp in s.
    reason : str
        Why it was refined or left unchanged, and how it ended.
    driven : Driven
        The chain as a whole.
    """

    start: Pose
    goals: tuple[Pose, ...]
    steps: tuple[RecordedStep, ...]
    began: float
    reason: str
    driven: Driven


def driven_of(record: Any) -> Driven:
    """Read a ChainPerformance.

    Raises
    ------
    MessageError
        A pose in it is none.
    """
    done = record.outcome.code == SUCCEEDED
    goals = [_pose(call.goal.pose) for call in record.chain.calls[-1:]]
    return Driven(
        time_of(record),
        tuple(printable(call.top, _LONGEST) for call in record.chain.calls),
        bool(record.refined),
        record.predicted.duration,
        record.actual.duration if done else math.nan,
        _outcome(record),
        (*_places(record.start), *goals),
    )


def chain_of_record(record: Any) -> RecordedChain:
    """Read a ChainPerformance, with all steps; raises MessageError where a pose in it is none."""
    driven = driven_of(record)
    return RecordedChain(
        _pose(record.start.robot),
        tuple(_pose(call.goal.pose) for call in record.chain.calls),
        tuple(map(step_of, record.actions)),
        time_of(record.start),
        _told(record.refinement, driven.outcome, record.outcome.reason),
        driven,
    )


def chain_of_actions(records: Sequence[Any]) -> RecordedChain:
    """Read the ActionPerformances of one chain, in order; raises MessageError."""
    first, last, steps = records[0], records[-1], tuple(map(step_of, records))
    done = last.outcome.code == SUCCEEDED and last.step + 1 == last.steps
    driven = Driven(
        time_of(last),
        tuple(step.top for step in steps),
        False,
        sum(step.predicted for step in steps),
        time_of(last) - time_of(first.start) if done else math.nan,
        _outcome(last),
        (*_places(first.start), steps[-1].goal),
    )
    reason = _told("only the records of its actions are there", driven.outcome, last.outcome.reason)
    goals = tuple(step.goal for step in steps)
    return RecordedChain(_pose(first.start.robot), goals, steps, time_of(first.start), reason, driven)


def step_of(record: Any) -> RecordedStep:
    """Read an ActionPerformance; raises MessageError where its goal is none."""
    return RecordedStep(
        record.step,
        printable(record.call.top, _LONGEST),
        _pose(record.call.goal.pose),
        time_of(record.start),
        time_of(record),
        record.predicted.duration,
        record.actual.duration if record.outcome.code == SUCCEEDED else math.nan,
    )


def _told(refinement: str, outcome: str, reason: str) -> str:
    ended = outcome if outcome == _OUTCOMES[SUCCEEDED] else f"{outcome}: {reason}"
    return printable(f"{refinement} ({ended})", _LONGEST_REASON)


def _outcome(record: Any) -> str:
    return _OUTCOMES.get(record.outcome.code, f"outcome {record.outcome.code}")


def _places(situation: Any) -> Iterable[Pose]:
    """Return where the robot and the objects of a situation are."""
    yield _pose(situation.robot)
    for there in situation.objects:
        where = object_from(there.position, there.velocity, "object")
        yield Pose(where.x, where.y, 0.0)


def time_of(message: Any) -> float:
    """Return the stamp of a record or a situation in s; raises MessageError."""
    return seconds_from(message.header.stamp)


def _pose(message: Any) -> Pose:
    return pose_from(message, "record")
