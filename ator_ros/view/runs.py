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
from ator_ros.world.readers import pose_from, world_from
from ator_ros.world.state import World

OTHERS = "others"  # label of the executions that other clients started
_MOST_CHAINS = 500  # that are kept
_SHOWN = 12  # chains in the table
_RECENT = 20  # chains in the model error
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
    # predicted durations in s of the calls in `naive`, in the order as sent; NaN without a model
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
    # of another client's goal: its start and its current chain, in the order as sent, with open
    # variables
    draft: Draft | None = None
    problem: str = ""  # why the executor reports no outcome, such as a failed start
    worlds: list[World] = field(default_factory=list)  # observed states since the start
    chain_id: str = ""  # id of the goal in records; empty before the start

    @property
    def ended(self) -> bool:
        """Whether the execution has ended."""
        if self.problem:
            return True
        return self.record is not None and bool(self.record.outcome.code)

    @property
    def driven(self) -> bool:
        """Whether driving has begun; before that, refinement may change the chain."""
        return self.record is not None and math.isfinite(self.record.actual.duration)

    @property
    def duration(self) -> float:
        """Duration of the whole chain in s; NaN until it has succeeded."""
        return math.nan if self.record is None else _duration_of(self.record)

    @property
    def actual(self) -> dict[int, float]:
        """Durations in s of the calls that have succeeded, by their index as sent."""
        actions = [] if self.record is None else self.record.actions
        return {
            each.step: each.actual.duration for each in actions if each.outcome.code == _SUCCEEDED
        }

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

    def observe(self, world: World) -> None:
        """Record the state of robot and objects; if the clock goes back, the path starts again."""
        if self.worlds and world.time < self.worlds[-1].time:
            self.worlds.clear()
        self.worlds.append(world)

    @property
    def path(self) -> list[tuple[float, float]]:
        """Places of the robot since the start: x and y in m."""
        return [world.robot.pose[:2] for world in self.worlds]

    @property
    def elapsed(self) -> float:
        """Time since the start in s, or the duration."""
        if math.isnan(self.duration) and self.worlds:
            return self.worlds[-1].time - self.worlds[0].time
        return 0.0 if math.isnan(self.duration) else self.duration


def plain(text: str) -> str:
    """Return a text escaped for Markdown."""
    return _MARKDOWN.sub(r"\\\1", printable(text, _LONGEST))


def seconds(value: float) -> str:
    """Return seconds with two decimals, `-` for NaN."""
    return "-" if math.isnan(value) else f"{value:.2f}"


def _duration_of(record: Any) -> float:
    return float(record.actual.duration) if record.outcome.code == _SUCCEEDED else math.nan


@dataclass(frozen=True)
class _Executed:
    """A chain that has ended: its record, the poses that it depends on, and its gain.

    `poses` are those of robot, objects and last goal. `gain` is the time saved in s over the newest
    naive chain of the same poses, NaN without one.
    """

    record: Any
    poses: list[Pose]
    gain: float


class History:
    """Executed chains."""

    def __init__(self) -> None:
        self._chains: deque[_Executed] = deque(maxlen=_MOST_CHAINS)  # the newest last

    def add(self, record: Any) -> None:
        """Add the record of a chain that has ended; raises MessageError if it cannot be read."""
        start = world_from(record.start, where="start")
        poses = [start.robot.pose]
        poses += [Pose(state.x, state.y, 0.0) for state in start.objects.values()]
        poses += [pose_from(call.goal.pose, "chain") for call in _calls_as_sent(record)[-1:]]
        gain = math.nan
        if record.refined:
            naive = (
                _duration_of(other.record)
                for other in reversed(self._chains)
                if not other.record.refined
                and _tops(other.record) == _tops(record)
                and _same(poses, other.poses)
            )
            gain = next(naive, math.nan) - _duration_of(record)
        self._chains.append(_Executed(record, poses, gain))

    def report(self) -> str:
        """Return, in Markdown, the mean error and gain, and the newest chains."""
        if not self._chains:
            return "no chain was executed yet"
        chains = list(self._chains)
        refined = sum(chain.record.refined for chain in chains)
        lines = [f"{len(chains)} chains, {refined} of them refined.", ""]
        recent = [chain.record for chain in chains[-_RECENT:]]
        errors = np.array([each.predicted.duration - _duration_of(each) for each in recent])
        errors = errors[np.isfinite(errors)]
        if len(errors):
            mean = f"mean {errors.mean():+.2f} s (predicted - actual)"
            lines += [
                f"Model error, last {len(errors)}: {np.abs(errors).mean():.2f} s, {mean}.",
                "",
            ]
        gains = [chain.gain for chain in chains if math.isfinite(chain.gain)]
        if gains:
            mean = f"{np.mean(gains):+.2f} s, mean of {len(gains)}"
            lines += [f"Gain over the naive chain from the same start: {mean}.", ""]
        lines += ["| | chain | predicted | actual | gain |", "|---|---|---|---|---|"]
        rows = [_row(number, chain) for number, chain in enumerate(chains, start=1)]
        return "\n".join([*lines, *reversed(rows[-_SHOWN:])])


def _tops(record: Any) -> list[str]:
    return [call.top for call in _calls_as_sent(record)]


def _calls_as_sent(record: Any) -> list[Any]:
    """Return the calls of a record's chain in the order as sent."""
    calls = record.chain.calls
    order = list(record.order) or range(len(calls))
    return [call for _, call in sorted(zip(order, calls, strict=True), key=lambda pair: pair[0])]


def _same(poses: Sequence[Pose], others: Sequence[Pose]) -> bool:
    """Return whether two chains have the same start and last goal, see `_Executed`."""
    if len(poses) != len(others):
        return False
    differences = [one.relative(other) for one, other in zip(poses, others, strict=True)]
    return all(max(math.hypot(x, y), abs(yaw)) < _SAME for x, y, yaw in differences)


def _row(number: int, chain: _Executed) -> str:
    record = chain.record
    name = f"{plain(', '.join(_tops(record)))} ({'refined' if record.refined else 'as sent'})"
    predicted = seconds(record.predicted.duration)
    actual = seconds(_duration_of(record))
    if math.isnan(_duration_of(record)):
        code = record.outcome.code
        actual = _OUTCOMES.get(code, f"outcome {code}")
    return f"| {number} | {name} | {predicted} | {actual} | {seconds(chain.gain)} |"
