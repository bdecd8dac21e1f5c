"""Answers of refinement, executions of chains, and their history, as the view shows them."""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ator_ros.execution.chain_executor import Ending
from ator_ros.geometry import Pose
from ator_ros.printable import printable
from ator_ros.refinement.refiner import SubgoalCurve
from ator_ros.tops.chain import TopChain
from ator_ros.view.draft import Draft
from ator_ros.world.messages import pose_from, world_from

OTHERS = "others"  # label of the executions that other clients started
# chains that are kept, in the table, and in the model error
_MOST_CHAINS, _SHOWN, _RECENT = 500, 12, 20
_LONGEST = 300  # characters
_SUCCEEDED = Ending.SUCCEEDED.value
_OUTCOMES = {ending.value: ending.name.lower().replace("_", " ") for ending in Ending}
_SAME = 0.05  # m and rad up to which two starts or goals count as the same
_MARKDOWN = re.compile(r"([\\`*_{}\[\]<>#|~$!])")


@dataclass(frozen=True, eq=False)
class Answer:
    """The answer of refinement."""

    naive: TopChain
    chain: TopChain  # to execute
    refined: bool
    reason: str  # of the gate
    # predicted durations in s of the steps of `naive`; NaN without a model
    before: tuple[float, ...] = ()
    after: tuple[float, ...] = ()  # the same of the best chain found
    curves: tuple[SubgoalCurve, ...] = ()
    chosen: int = 0  # number of the chosen alternative; 0: the chain itself
    cut_short: bool = False  # whether the deadline ended the search


@dataclass
class Run:
    """One execution of a chain."""

    label: str  # "naive", "refined" or "others"
    record: Any = None  # the executor's newest ChainPerformance; None before the first one
    # of another client's goal: its start and current chain, with open variables
    draft: Draft | None = None
    problem: str = ""  # why the executor reports no outcome, such as a failed start
    poses: list[Pose] = field(default_factory=list)  # path of the robot since the start
    chain_id: str = ""  # id of the goal in records; empty before the start
    _start: float = math.nan  # s, of the clock of `record_pose`
    _newest: float = math.nan

    @property
    def ended(self) -> bool:
        """Whether the execution has ended."""
        return bool(self.problem) or (self.record is not None and bool(self.record.outcome.code))

    @property
    def driven(self) -> bool:
        """Whether driving has begun; before that, refinement may change the chain."""
        return self.record is not None and math.isfinite(self.record.actual.duration)

    @property
    def duration(self) -> float:
        """Duration of the whole chain in s; NaN until it has succeeded."""
        return math.nan if self.record is None else _duration_of(self.record)

    @property
    def actual(self) -> list[float]:
        """Durations in s of the steps that have succeeded."""
        actions = [] if self.record is None else self.record.actions
        return [each.actual.duration for each in actions if each.outcome.code == _SUCCEEDED]

    @property
    def reason(self) -> str:
        """Result of refinement or, before driving, what the executor waits for."""
        if self.record is None:
            return ""
        return printable(
            self.record.refinement if self.driven else self.record.outcome.reason, _LONGEST
        )

    @property
    def status(self) -> str:
        """The current phase or the outcome."""
        if self.problem or self.record is None:
            return self.problem or "starting"
        outcome, refinement = self.record.outcome, printable(self.record.refinement, _LONGEST)
        reason = "done" if outcome.code == _SUCCEEDED else printable(outcome.reason, _LONGEST)
        prefix = "of others: " if self.label == OTHERS else ""
        return f"{prefix}{reason}{f' ({refinement})' if outcome.code else ''}"

    def record_pose(self, time: float, pose: Pose) -> None:
        """Record the robot's pose at `time` s; if the clock goes back, the path starts again."""
        if not time >= self._newest:
            self._start = time
            self.poses.clear()
        self._newest = time
        self.poses.append(pose)

    @property
    def elapsed(self) -> float:
        """Time since the start in s, or the duration."""
        if not math.isnan(self.duration):
            return self.duration
        return self._newest - self._start if self.poses else 0.0


def plain(text: str) -> str:
    """Return a text escaped for Markdown."""
    return _MARKDOWN.sub(r"\\\1", printable(text, _LONGEST))


def seconds(value: float) -> str:
    """Return seconds with two decimals, `-` for NaN."""
    return "-" if math.isnan(value) else f"{value:.2f}"


def _duration_of(record: Any) -> float:
    return float(record.actual.duration) if record.outcome.code == _SUCCEEDED else math.nan


class History:
    """Executed chains."""

    def __init__(self) -> None:
        self._chains: deque[tuple[Any, list[Pose], float]] = deque(maxlen=_MOST_CHAINS)
        """Record, poses of robot, objects and last goal, and gain in s of each, the newest last."""

    def add(self, record: Any) -> None:
        """Add the record of a chain that has ended; raises MessageError if it cannot be read."""
        start, last = world_from(record.start, where="start"), record.chain.calls[-1:]
        poses = [start.robot.pose, *(Pose(each.x, each.y, 0.0) for each in start.objects.values())]
        poses += [pose_from(call.goal.pose, "chain") for call in last]
        gain = math.nan
        if record.refined:
            naive_durations = (
                _duration_of(other)
                for other, others, _ in reversed(self._chains)
                if not other.refined and _tops(other) == _tops(record) and _same(poses, others)
            )
            gain = next(naive_durations, math.nan) - _duration_of(record)  # against the newest
        self._chains.append((record, poses, gain))

    def report(self) -> str:
        """Return, in Markdown, the mean error and gain, and the newest chains."""
        if not self._chains:
            return "no chain was executed yet"
        records, _, gains = zip(*self._chains, strict=True)
        lines = [
            f"{len(records)} chains, {sum(record.refined for record in records)} of them refined.",
            "",
        ]
        errors = np.array(
            [each.predicted.duration - _duration_of(each) for each in records[-_RECENT:]]
        )
        errors = errors[np.isfinite(errors)]
        if len(errors):
            error = (
                f"{np.abs(errors).mean():.2f} s, mean {errors.mean():+.2f} s (predicted - actual)"
            )
            lines += [f"Model error, last {len(errors)}: {error}.", ""]
        known = [gain for gain in gains if math.isfinite(gain)]
        if known:
            mean = f"{np.mean(known):+.2f} s, mean of {len(known)}"
            lines += [f"Gain over the naive chain from the same start: {mean}.", ""]
        lines += ["| | chain | predicted | actual | gain |", "|---|---|---|---|---|"]
        rows = map(_row, range(1, len(records) + 1), records, gains)
        return "\n".join([*lines, *reversed(list(rows)[-_SHOWN:])])


def _tops(record: Any) -> list[str]:
    return [call.top for call in record.chain.calls]


def _same(poses: Sequence[Pose], others: Sequence[Pose]) -> bool:
    """Return whether two chains have the same start and last goal, see `History`."""
    pairs = zip(poses, others, strict=False)
    near = (a.distance(b) < _SAME and abs(a.relative(b).yaw) < _SAME for a, b in pairs)
    return len(poses) == len(others) and all(near)


def _row(number: int, record: Any, gain: float) -> str:
    name = f"{plain(', '.join(_tops(record)))} ({'refined' if record.refined else 'as sent'})"
    code, duration = record.outcome.code, _duration_of(record)
    actual = _OUTCOMES.get(code, f"outcome {code}") if math.isnan(duration) else seconds(duration)
    return (
        f"| {number} | {name} | {seconds(record.predicted.duration)} | {actual} | {seconds(gain)} |"
    )
