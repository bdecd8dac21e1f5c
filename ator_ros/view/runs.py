"""What the view shows of refinement and executor: answers, executions, and the history of chains."""

from __future__ import annotations

import itertools
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

OTHERS = "others"
"""The label of an execution that this view did not start."""
_MOST = 500
_SHOWN = 12
_RECENT = 20
_LONGEST = 300
_SUCCEEDED = Ending.SUCCEEDED.value
_OUTCOMES = {ending.value: ending.name.lower().replace("_", " ") for ending in Ending}
_SAME = 0.05  # m and rad up to which two starts or goals count as the same
_MARKDOWN = re.compile(r"([\\`*_{}\[\]<>#|~$!])")


@dataclass(frozen=True, eq=False)
class Answer:
    """The answer of refinement: the naive chain, and the one to execute, which differs if it is `refined`.

    Attributes
    ----------
    reason : str
        Why the chain was refined or left unchanged: the gate's words.
    before, after : tuple of float
        Predicted durations in s of the steps of `naive`, and of the best chain found; NaN without a model.
    chosen : int
        The number of the alternative that all this is about; 0: the chain itself.
    """

    naive: TopChain
    chain: TopChain
    refined: bool
    reason: str
    before: tuple[float, ...] = ()
    after: tuple[float, ...] = ()
    curves: tuple[SubgoalCurve, ...] = ()
    chosen: int = 0


@dataclass
class Run:
    """One execution of a chain.

    Attributes
    ----------
    label : str
        "naive", "refined" or "others".
    record : ChainPerformance or None
        The executor's newest record of it; None before the first one.
    draft : Draft or None
        Of a goal that another client sent: the situation in which it starts, and its chain as it is at
        present, with open variables.
    problem : str
        Why it has no end that the executor reports: it could not start, or is lost; else empty.
    poses : list of Pose
        Where the robot was, since the start.
    """

    label: str
    record: Any = None
    draft: Draft | None = None
    problem: str = ""
    poses: list[Pose] = field(default_factory=list)
    _start: float = math.nan
    _newest: float = math.nan

    @property
    def ended(self) -> bool:
        """Whether it has ended."""
        return bool(self.problem) or (self.record is not None and bool(self.record.outcome.code))

    @property
    def driven(self) -> bool:
        """Whether it is driven, or was; before that, refinement may still change its chain."""
        return self.record is not None and math.isfinite(self.record.actual.duration)

    @property
    def duration(self) -> float:
        """Of the whole chain in s; NaN while it runs, or if it failed."""
        return math.nan if self.record is None else duration_of(self.record)

    @property
    def actual(self) -> list[float]:
        """Durations in s of the steps that have succeeded."""
        actions = [] if self.record is None else self.record.actions
        return [each.actual.duration for each in actions if each.outcome.code == _SUCCEEDED]

    @property
    def reason(self) -> str:
        """Why refinement has changed its chain or left it; before it is driven, what it waits for."""
        if self.record is None:
            return ""
        return printable(self.record.refinement if self.driven else self.record.outcome.reason, _LONGEST)

    @property
    def status(self) -> str:
        """The present phase, or how it ended."""
        if self.problem or self.record is None:
            return self.problem or "starting"
        outcome, refinement = self.record.outcome, printable(self.record.refinement, _LONGEST)
        reason = "done" if outcome.code == _SUCCEEDED else printable(outcome.reason, _LONGEST)
        prefix = "of others: " if self.label == OTHERS else ""
        return f"{prefix}{reason}{f' ({refinement})' if outcome.code else ''}"

    def record_pose(self, time: float, pose: Pose) -> None:
        """Record the robot's pose at `time` s; a clock that goes back restarts the trail."""
        if not time >= self._newest:
            self._start = time
            self.poses.clear()
        self._newest = time
        self.poses.append(pose)

    @property
    def elapsed(self) -> float:
        """Seconds since its start; its duration once that is known."""
        if not math.isnan(self.duration):
            return self.duration
        return self._newest - self._start if self.poses else 0.0


# The history of executed chains


def plain(text: str) -> str:
    """Return a text escaped for Markdown."""
    return _MARKDOWN.sub(r"\\\1", printable(text, _LONGEST))


def seconds(value: float) -> str:
    """Return a number of seconds for a table; `-` if it is unknown."""
    return "-" if math.isnan(value) else f"{value:.2f}"


def duration_of(record: Any) -> float:
    """Return the duration in s of a chain by its record; NaN unless it succeeded."""
    return float(record.actual.duration) if record.outcome.code == _SUCCEEDED else math.nan


class History:
    """Executed chains, the newest last."""

    def __init__(self) -> None:
        self._chains: deque[tuple[Any, list[Pose], float]] = deque(maxlen=_MOST)
        """The record of each, where robot, objects and the last goal were, and its gain in s."""

    def add(self, record: Any) -> None:
        """Add a chain that has ended by its record; raises MessageError if that cannot be read."""
        start, last = world_from(record.start, where="start"), record.chain.calls[-1:]
        places = [start.robot.pose, *(Pose(there.x, there.y, 0.0) for there in start.objects.values())]
        places += [pose_from(call.goal.pose, "chain") for call in last]
        gain = math.nan
        if record.refined:
            tops = _tops(record)
            naive = (
                duration_of(other)
                for other, others, _ in reversed(self._chains)
                if not other.refined and _tops(other) == tops and _same(places, others)
            )
            gain = next(naive, math.nan) - duration_of(record)
        self._chains.append((record, places, gain))

    def report(self) -> str:
        """Return, in Markdown, the mean error and gain, and the newest chains."""
        rows = [(record, gain) for record, _, gain in self._chains]
        if not rows:
            return "no chain was executed yet"
        lines = [f"{len(rows)} chains, {sum(record.refined for record, _ in rows)} of them refined.", ""]
        differences = (each.predicted.duration - duration_of(each) for each, _ in rows[-_RECENT:])
        errors = [error for error in differences if math.isfinite(error)]
        if errors:
            size, bias = float(np.mean(np.abs(errors))), float(np.mean(errors))
            lines += [
                f"Model error, last {len(errors)}: {size:.2f} s, mean {bias:+.2f} s (predicted - actual).",
                "",
            ]
        gains = [gain for _, gain in rows if math.isfinite(gain)]
        if gains:
            mean = f"{np.mean(gains):+.2f} s, mean of {len(gains)}"
            lines += [f"Gain over the naive chain from the same start: {mean}.", ""]
        lines += ["| | chain | predicted | actual | gain |", "|---|---|---|---|---|"]
        newest = itertools.islice(reversed(list(enumerate(rows, 1))), _SHOWN)
        return "\n".join([*lines, *(_row(number, *row) for number, row in newest)])


def _tops(record: Any) -> list[str]:
    return [call.top for call in record.chain.calls]


def _same(places: Sequence[Pose], others: Sequence[Pose]) -> bool:
    pairs = zip(places, others, strict=False)
    near = (a.distance(b) < _SAME and abs(a.relative(b).yaw) < _SAME for a, b in pairs)
    return len(places) == len(others) and all(near)


def _row(number: int, record: Any, gain: float) -> str:
    name = f"{plain(', '.join(_tops(record)))} ({'refined' if record.refined else 'as sent'})"
    code, duration = record.outcome.code, duration_of(record)
    actual = f"{duration:.2f}" if math.isfinite(duration) else _OUTCOMES.get(code, f"outcome {code}")
    return f"| {number} | {name} | {seconds(record.predicted.duration)} | {actual} | {seconds(gain)} |"
