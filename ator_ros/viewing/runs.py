"""Executions of chains as a view shows them: times by step, the way driven, and races between two."""

from __future__ import annotations

import bisect
import math
from dataclasses import dataclass, field

from ator_ros.geometry import Pose


@dataclass
class Run:
    """One execution of a chain.

    Attributes
    ----------
    label : str
        "naive" or "refined".
    predicted, actual : list of float
        Durations in s of the steps; `actual` as far as they have ended.
    status : str
        What it does, or how it ended.
    duration : float
        Of the whole chain in s; NaN while it runs, or where it failed.
    ended : bool
        Whether it has ended.
    times, poses : list
        Seconds since the start, ascending, and where the robot was then.
    """

    label: str
    predicted: list[float] = field(default_factory=list)
    actual: list[float] = field(default_factory=list)
    status: str = "starts"
    duration: float = math.nan
    ended: bool = False
    times: list[float] = field(default_factory=list)
    poses: list[Pose] = field(default_factory=list)
    _began: float = math.nan

    def saw(self, time: float, pose: Pose) -> None:
        """Record where the robot is at `time` s; a clock that goes back restarts the way."""
        if math.isnan(self._began) or (self.times and time < self._began + self.times[-1]):
            self._began = time
            self.times.clear()
            self.poses.clear()
        self.times.append(time - self._began)
        self.poses.append(pose)

    @property
    def elapsed(self) -> float:
        """Seconds since its start: the duration once that is known."""
        if not math.isnan(self.duration):
            return self.duration
        return self.times[-1] if self.times else 0.0

    def pose_at(self, seconds: float) -> Pose | None:
        """Return where the robot was so long after the start; None if nothing was recorded."""
        if not self.poses:
            return None
        return self.poses[min(bisect.bisect_left(self.times, seconds), len(self.poses) - 1)]


@dataclass(frozen=True, slots=True)
class Race:
    """Two executions from the same start; the second is driven beside the ghost of the first."""

    first: Run
    second: Run

    @property
    def verdict(self) -> str:
        """How it ended, in words; empty while one of them runs."""
        if not (self.first.ended and self.second.ended):
            return ""
        times = [(run.label, run.duration) for run in (self.first, self.second)]
        failed = [label for label, duration in times if math.isnan(duration)]
        if failed:
            return f"{' and '.join(failed)} failed"
        (first, a), (second, b) = times
        percent = 100.0 * (a - b) / (a or math.inf)
        return f"{first} {a:.2f} s, {second} {b:.2f} s: gain {a - b:+.2f} s ({percent:+.0f} %)"
