"""Transforms between frames, as on /tf, and the pose of one frame in another; without ROS."""

from __future__ import annotations

import bisect
from collections import deque
from dataclasses import dataclass, field
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from ator_ros.geometry import FloatArray

_LATELY = 2.0  # s after the newest transform of all
_KEPT = 512  # transforms of each frame that are remembered: five seconds at 100 Hz

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


class Placement(NamedTuple):
    """The pose of a frame in space: its origin in m, and a unit quaternion (x, y, z, w)."""

    origin: Vector
    turn: Quaternion

    def compose(self, local: Placement) -> Placement:
        """Return the placement `local`, seen from this one, in the frame of this one."""
        turn = Rotation.from_quat(self.turn)
        origin = np.add(self.origin, turn.apply(local.origin))
        return _placement(origin, turn * Rotation.from_quat(local.turn))

    def inverse(self) -> Placement:
        """Return the inverse transform."""
        back = Rotation.from_quat(self.turn).inv()
        return _placement(-back.apply(self.origin), back)

    def between(self, other: Placement, share: float) -> Placement:
        """Return the placement at `share` (0 to 1) of the way from this to `other`."""
        origin = np.add(self.origin, share * np.subtract(other.origin, self.origin))
        turns = Slerp([0.0, 1.0], Rotation.from_quat([self.turn, other.turn]))
        return _placement(origin, turns(share))


def _placement(origin: FloatArray, turn: Rotation) -> Placement:
    return Placement(tuple(origin.tolist()), tuple(turn.as_quat().tolist()))


HERE = Placement((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
"""A frame in itself."""


@dataclass
class _Link:
    """What is known of a frame in its parent: placements with their times, or one that always holds."""

    parent: str
    fixed: bool
    known: deque[tuple[float, Placement]] = field(default_factory=lambda: deque(maxlen=_KEPT))

    def add(self, time: float, placement: Placement) -> None:
        """Take a placement; one from before the last means that the clock was reset."""
        if self.known and (self.fixed or time < self.known[-1][0]):
            self.known.clear()
        elif self.known and time == self.known[-1][0]:
            self.known.pop()
        self.known.append((time, placement))

    def at(self, time: float) -> Placement | None:
        """Return the placement at `time` (s); None where that is not remembered."""
        if self.fixed:
            return self.known[-1][1]
        index = bisect.bisect_left(self.known, time, key=itemgetter(0))
        if index == len(self.known) or (index == 0 and self.known[0][0] > time):
            return None
        end, after = self.known[index]
        if end == time:
            return after
        begin, before = self.known[index - 1]
        return before.between(after, (time - begin) / (end - begin))


class Transforms:
    """The recent transforms of all frames."""

    def __init__(self) -> None:
        self._links: dict[str, _Link] = {}

    @property
    def frames(self) -> list[str]:
        """The names of all frames, sorted."""
        return sorted({*self._links, *(link.parent for link in self._links.values())})

    def add(self, frame: str, child: str, time: float, placement: Placement, *, fixed: bool = False) -> None:
        """Take the placement of the frame `child` in `frame` at `time` (s), or at all times if it is `fixed`.

        It must be finite, with a unit quaternion.
        """
        link = self._links.get(child)
        if link is None or (link.parent, link.fixed) != (frame, fixed):
            link = self._links[child] = _Link(frame, fixed)
        link.add(time, placement)

    def latest(self, frame: str, child: str) -> tuple[float, Placement] | None:
        """Return the newest time in s at which `child` is known in `frame`, and its placement then.

        The time is that of the oldest of the newest transforms between the two frames; those that never
        change hold at the present. None: no transforms connect the frames, or those that move share no time.
        """
        up, down = self._ancestors(child), self._ancestors(frame)
        common = next((name for name in up if name in down), None)
        if common is None:
            return None
        rising, falling = up[: up.index(common)], down[: down.index(common)]
        links = [self._links[name] for name in rising + falling]
        time = min((link.known[-1][0] for link in links if not link.fixed), default=self.present)
        there, back = self._in_ancestor(rising, time), self._in_ancestor(falling, time)
        return None if there is None or back is None else (time, back.inverse().compose(there))

    def latest_in_odometry(self, frame: str, child: str) -> tuple[float, Placement] | None:
        """Return what `latest` does, in the frame named odom (REP-105) if `child` is placed in one.

        The pose there has no corrections, as those of a localization.
        """
        odometry = (name for name in self._ancestors(child) if name.rpartition("/")[2] == "odom")
        return self.latest(next(odometry, frame), child)

    @property
    def present(self) -> float:
        """The time in s up to which every frame that moves is known; 0 if none moves.

        Localization dates its transforms ahead of odometry. Frames without recent transforms do not count.
        """
        newest = [link.known[-1][0] for link in self._links.values() if not link.fixed]
        latest = max(newest, default=0.0)
        return min((time for time in newest if time >= latest - _LATELY), default=0.0)

    def _ancestors(self, frame: str) -> list[str]:
        """Return a frame, its parent, and so on; where they run in a circle, each once."""
        names = {frame: None}
        while (link := self._links.get(frame)) is not None and link.parent not in names:
            frame = link.parent
            names[frame] = None
        return list(names)

    def _in_ancestor(self, names: list[str], time: float) -> Placement | None:
        """Return the placement of the first of `names` in the parent of the last."""
        placement = HERE
        for name in names:
            step = self._links[name].at(time)
            if step is None:
                return None
            placement = step.compose(placement)
        return placement
