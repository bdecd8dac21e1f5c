"""The transforms on /tf, and the pose of one frame in another; without ROS."""

from __future__ import annotations

import bisect
import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import chain
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from ator_ros.geometry import FloatArray, yaw_from_quaternion
from ator_ros.world.senders import LEAST_IN_ODOMETRY, PoseSenderCheck

_RECENT = 2.0  # s before the newest transform of all
_KEPT = 512  # transforms of each frame: five seconds at 100 Hz
# times in a row that a frame changed to its parent before: moved by hand between two parents, it
# does so less often
_FEWEST_CHANGES = 8
_LONGEST_PAUSE = 1.5  # s without such a change after which one of the two senders has ended

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


class Placement(NamedTuple):
    """The pose of a frame in space: its origin in m, and a unit quaternion (x, y, z, w)."""

    origin: Vector
    turn: Quaternion

    def compose(self, local: Placement) -> Placement:
        """Return the placement `local`, which is relative to this one, in the frame of this one."""
        turn = Rotation.from_quat(self.turn)
        origin = np.add(self.origin, turn.apply(local.origin))
        return _placement(origin, turn * Rotation.from_quat(local.turn))

    def inverse(self) -> Placement:
        """Return the inverse transform."""
        back = Rotation.from_quat(self.turn).inv()
        return _placement(-back.apply(self.origin), back)

    def between(self, other: Placement, share: float) -> Placement:
        """Return the interpolation between this (`share` 0) and `other` (1)."""
        origin = np.add(self.origin, share * np.subtract(other.origin, self.origin))
        turns = Slerp([0.0, 1.0], Rotation.from_quat([self.turn, other.turn]))
        return _placement(origin, turns(share))


def _placement(origin: FloatArray, turn: Rotation) -> Placement:
    return Placement(tuple(origin.tolist()), tuple(turn.as_quat().tolist()))


HERE = Placement((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
"""The placement of a frame in itself."""


@dataclass
class _Link:
    """The recent placements of a frame in its parent, or the last one if it is fixed."""

    parent: str
    fixed: bool
    senders: PoseSenderCheck
    placements: deque[tuple[float, Placement]] = field(default_factory=lambda: deque(maxlen=_KEPT))
    difference: str = ""  # between the placements of two senders; empty with one
    before: str = ""  # the parent before
    changes: int = 0  # from and to that parent in turn
    changed_at: float = -math.inf  # s

    @property
    def newest(self) -> float:
        """The time of the newest placement in s."""
        return self.placements[-1][0]

    @property
    def has_two_parents(self) -> bool:
        """Whether the parent alternates between two frames."""
        is_over = self.newest - self.changed_at > _LONGEST_PAUSE
        return self.changes >= _FEWEST_CHANGES and not is_over

    def add(self, time: float, placement: Placement) -> None:
        """Add a placement; if it is older than the last one, the clock was reset."""
        if not self.fixed:
            yaw = yaw_from_quaternion(*placement.turn)
            self.difference = self.senders.difference(time, *placement.origin[:2], yaw)
        if self.placements and (self.fixed or time < self.newest):
            self.placements.clear()
        elif self.placements and time == self.newest:
            self.placements.pop()
        self.placements.append((time, placement))

    def at(self, time: float) -> Placement | None:
        """Return the placement at `time` (s); None if it is unknown."""
        if self.fixed:
            return self.placements[-1][1]
        if not self.placements[0][0] <= time <= self.newest:
            return None
        index = bisect.bisect_left(self.placements, time, key=itemgetter(0))
        end, after = self.placements[index]
        if end == time:
            return after
        begin, before = self.placements[index - 1]
        return before.between(after, (time - begin) / (end - begin))


def _is_odometry(frame: str) -> bool:
    """Return whether a frame is odom (REP-105), in a namespace or not."""
    return frame.rpartition("/")[2] == "odom"


class Transforms:
    """The recent transforms of all frames."""

    def __init__(self) -> None:
        self._links: dict[str, _Link] = {}

    @property
    def frames(self) -> list[str]:
        """The names of all frames, sorted."""
        return sorted({*self._links, *(link.parent for link in self._links.values())})

    def add(
        self,
        frame: str,
        child: str,
        time: float,
        placement: Placement,
        *,
        fixed: bool = False,
    ) -> None:
        """Add the placement of `child` in `frame` at `time` (s), or of all times if `fixed`."""
        link = self._links.get(child)
        if link is None or (link.parent, link.fixed) != (frame, fixed):
            link = self._links[child] = self._changed(link, frame, time, fixed=fixed)
        link.add(time, placement)

    @staticmethod
    def _changed(
        link: _Link | None,
        parent: str,
        time: float,
        *,
        fixed: bool,
    ) -> _Link:
        """Return a link to a new parent, which counts changes to and fro between two parents."""
        check = PoseSenderCheck()
        if _is_odometry(parent):
            check = PoseSenderCheck(least=LEAST_IN_ODOMETRY)
        if link is None or link.parent == parent:
            return _Link(parent, fixed, check)
        again = link.before == parent and abs(time - link.changed_at) <= _LONGEST_PAUSE
        changes = link.changes + 1 if again else 1
        return _Link(parent, fixed, check, before=link.parent, changes=changes, changed_at=time)

    def latest(self, frame: str, child: str) -> tuple[float, Placement] | None:
        """Return the newest time in s at which `child` is known in `frame`, and its placement then.

        None: no transforms connect the frames, or their known times do not overlap.
        """
        path = self._path(frame, child)
        if path is None:
            return None
        moving = (link.newest for _, link in self._named_links(path) if not link.fixed)
        time = min(moving, default=self.present)
        placement = self.at(frame, child, time)
        return None if placement is None else (time, placement)

    def at(self, frame: str, child: str, time: float) -> Placement | None:
        """Return the placement of `child` in `frame` at a time in s; None if it is unknown."""
        path = self._path(frame, child)
        if path is None:
            return None
        rising, falling = path
        there = self._in_ancestor(rising, time)
        back = self._in_ancestor(falling, time)
        if there is None or back is None:
            return None
        return back.inverse().compose(there)

    def second_parent(self, frame: str, child: str) -> tuple[str, str, str] | None:
        """Return a frame between two frames whose parent alternates, and its two parents.

        None if there is none. One of the parents may be unconnected to the other frame.
        """
        path = self._path(frame, child) or (self._ancestors(child), self._ancestors(frame))
        for name, link in self._named_links(path):
            if link.has_two_parents:
                one, other = sorted((link.parent, link.before))
                return name, one, other
        return None

    def second_sender(self, frame: str, child: str) -> tuple[str, str, str] | None:
        """Return parent, frame and difference of a transform between two frames with two senders.

        None if there is none.
        """
        for name, link in self._named_links(self._path(frame, child) or ([], [])):
            if link.difference:
                return link.parent, name, link.difference
        return None

    def latest_in_odometry(self, frame: str, child: str) -> tuple[float, Placement] | None:
        """Return `latest` in odom (REP-105), which localization does not correct, if it exists."""
        odometry = (name for name in self._ancestors(child) if _is_odometry(name))
        return self.latest(next(odometry, frame), child)

    @property
    def present(self) -> float:
        """The time in s up to which all frames that moved recently are known.

        It is 0 if no frame moves.
        """
        newest = [link.newest for link in self._links.values() if not link.fixed]
        latest = max(newest, default=0.0)
        return min((time for time in newest if time >= latest - _RECENT), default=0.0)

    def _named_links(self, path: tuple[list[str], list[str]]) -> Iterator[tuple[str, _Link]]:
        """Yield the frames of a path that have a parent, and their links to it."""
        for name in chain(*path):
            if name in self._links:
                yield name, self._links[name]

    def _path(self, frame: str, child: str) -> tuple[list[str], list[str]] | None:
        """Return the frames from `child` and `frame` up to below their common ancestor, or None."""
        up = self._ancestors(child)
        down = self._ancestors(frame)
        common = next((name for name in up if name in down), None)
        if common is None:
            return None
        return up[: up.index(common)], down[: down.index(common)]

    def _ancestors(self, frame: str) -> list[str]:
        """Return a frame, its parent, and so on; each once if they form a cycle."""
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
