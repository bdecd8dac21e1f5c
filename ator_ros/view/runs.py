"""What the view shows of refinement and executor: answers, executions, and the history of chains."""

from __future__ import annotations

import bisect
import itertools
import math
import re
from collections import deque
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ator_ros.geometry import Pose
from ator_ros.printable import printable
from ator_ros.refinement.refiner import SubgoalCurve
from ator_ros.tops.chain import TopChain
from ator_ros.view.draft import Draft

OTHERS = "others"
"""The label of an execution that this view did not start."""
_MOST = 500
_SHOWN = 12
_RECENT = 20
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
    actual : list of float
        Durations in s of the steps that have succeeded.
    status : str
        The present phase, or how it ended.
    started, ended : bool
        Whether the executor has reported it, and whether it has ended.
    duration : float
        Of the whole chain in s; NaN while it runs, or if it failed.
    times, poses : list
        Seconds since the start, ascending, and where the robot was then.
    record : ChainPerformance or None
        The executor's record, once the chain has ended.
    """

    label: str
    actual: list[float] = field(default_factory=list)
    status: str = "starting"
    started: bool = False
    duration: float = math.nan
    ended: bool = False
    times: list[float] = field(default_factory=list)
    poses: list[Pose] = field(default_factory=list)
    record: Any = None
    _start: float = math.nan

    def record_pose(self, time: float, pose: Pose) -> None:
        """Record the robot's pose at `time` s; a clock that goes back restarts the trail."""
        if math.isnan(self._start) or (self.times and time < self._start + self.times[-1]):
            self._start = time
            self.times.clear()
            self.poses.clear()
        self.times.append(time - self._start)
        self.poses.append(pose)

    @property
    def elapsed(self) -> float:
        """Seconds since its start; its duration once that is known."""
        if not math.isnan(self.duration):
            return self.duration
        return self.times[-1] if self.times else 0.0

    def pose_at(self, seconds: float) -> Pose | None:
        """Return the pose so long after the start; None if nothing was recorded."""
        if not self.poses:
            return None
        return self.poses[min(bisect.bisect_left(self.times, seconds), len(self.poses) - 1)]


@dataclass(frozen=True, eq=False)
class ExternalGoal:
    """A goal that another client sent to the executor.

    Attributes
    ----------
    chain_id : str
        The goal's UUID.
    draft : Draft
        The situation in which it starts, and the chain as it is at present, with open variables.
    run : Run
        Its execution; the same object as long as the goal is the same.
    driven : bool
        Whether it is driven; before that, refinement may still change it.
    refined, changes : bool, int
        Whether refinement has changed it, and how often while it was driven.
    reason : str
        Why refinement has changed it or left it unchanged; before it is driven, what it waits for.
    """

    chain_id: str
    draft: Draft
    run: Run
    driven: bool = False
    refined: bool = False
    changes: int = 0
    reason: str = ""


# The history of executed chains


def plain(text: str, most: int = 300) -> str:
    """Return a text escaped for Markdown."""
    return _MARKDOWN.sub(r"\\\1", printable(text, most))


def seconds(value: float) -> str:
    """Return a number of seconds for a table; `-` if it is unknown."""
    return "-" if math.isnan(value) else f"{value:.2f}"


@dataclass(frozen=True, slots=True)
class ExecutedChain:
    """One executed chain: its TOPs, whether refinement changed it, and how it ended.

    `predicted` and `actual` are its duration in s as predicted at the start, and as measured; NaN if unknown,
    or if it failed. `places` are where robot and objects were at the start, and the chain's last goal.
    """

    tops: tuple[str, ...]
    refined: bool
    predicted: float
    actual: float
    outcome: str
    places: tuple[Pose, ...]

    def repeats(self, other: ExecutedChain) -> bool:
        """Return whether it had the same TOPs, start and goal as another one."""
        return (
            self.tops == other.tops
            and len(self.places) == len(other.places)
            and all(
                a.distance(b) < _SAME and abs(a.relative(b).yaw) < _SAME
                for a, b in zip(self.places, other.places, strict=True)
            )
        )


class History:
    """Executed chains, the newest last."""

    def __init__(self) -> None:
        self._chains: deque[tuple[ExecutedChain, float]] = deque(maxlen=_MOST)

    def add(self, chain: ExecutedChain) -> None:
        """Add a chain that has ended."""
        gain = math.nan
        if chain.refined:
            naive = (other for other, _ in reversed(self._chains) if not other.refined)
            gain = next((other.actual - chain.actual for other in naive if chain.repeats(other)), math.nan)
        self._chains.append((chain, gain))

    def report(self) -> str:
        """Return, in Markdown, the mean error and gain, and the newest chains."""
        rows = tuple(self._chains)
        if not rows:
            return "no chain was executed yet"
        lines = [f"{len(rows)} chains, {sum(chain.refined for chain, _ in rows)} of them refined.", ""]
        differences = (chain.predicted - chain.actual for chain, _ in rows[-_RECENT:])
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


def _row(number: int, chain: ExecutedChain, gain: float) -> str:
    name = f"{plain(', '.join(chain.tops))} ({'refined' if chain.refined else 'as sent'})"
    actual = f"{chain.actual:.2f}" if math.isfinite(chain.actual) else plain(chain.outcome)
    return f"| {number} | {name} | {seconds(chain.predicted)} | {actual} | {seconds(gain)} |"
