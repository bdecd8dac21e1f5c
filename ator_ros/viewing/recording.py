"""What a view plays of a recording: where a robot and its objects were, and the chains that it executed."""

from __future__ import annotations

import bisect
import itertools
from collections.abc import Sequence
from dataclasses import dataclass

from ator_ros.experience.streams import Track
from ator_ros.viewing.history import History
from ator_ros.viewing.recorded import RecordedChain
from ator_ros.world.state import World


@dataclass(frozen=True)
class PlayedChain:
    """A chain with its place in what is played: s from the recording's begin."""

    began: float
    ended: float
    chain: RecordedChain


class RecordedRobot:
    """One robot of a recording, by s since its first state; where nothing was recorded, no time passes.

    Parameters
    ----------
    tracks : sequence of Track
        Stretches of its time, at least one.
    chains : sequence of (int, RecordedChain)
        What it executed, each with the stretch in which its record was heard.

    Attributes
    ----------
    duration : float
        In s.
    chains : tuple of PlayedChain
        In order of their begins.
    history : History
        The same chains, for a table.
    """

    def __init__(self, tracks: Sequence[Track], chains: Sequence[tuple[int, RecordedChain]]) -> None:
        self._tracks = tuple(tracks)
        lengths = [track.end - track.begin for track in tracks]
        self._offsets = [0.0, *itertools.accumulate(lengths)]
        self.duration = self._offsets.pop()
        played = [
            PlayedChain(self._seconds(number, chain.began), self._seconds(number, chain.driven.ended), chain)
            for number, chain in chains
        ]
        self.chains = tuple(sorted(played, key=lambda one: one.began))
        self.history = History()
        for one in self.chains:
            self.history.add(one.chain.driven)

    def _seconds(self, number: int, stamp: float) -> float:
        """Return when something with a stamp was that was heard in a stretch; it may have begun before."""
        while number > 0 and stamp < self._tracks[number].begin and self._tracks[number - 1].begin <= stamp:
            number -= 1
        track = self._tracks[number]
        return self._offsets[number] + min(max(stamp, track.begin), track.end) - track.begin

    def _there(self, seconds: float) -> tuple[Track, float]:
        number = max(0, bisect.bisect_right(self._offsets, seconds) - 1)
        track = self._tracks[number]
        return track, min(track.begin + max(0.0, seconds - self._offsets[number]), track.end)

    def world(self, seconds: float) -> World:
        """Return the state, with the stamp of that time."""
        track, stamp = self._there(seconds)
        return track.world(stamp)

    def seconds_at(self, stamp: float) -> float:
        """Return when a stamp (s) is played; 0 where nothing was recorded then."""
        number = self._number(stamp)
        return 0.0 if number is None else self._seconds(number, stamp)

    def world_at_stamp(self, stamp: float) -> World | None:
        """Return the state at a stamp (s); None where none was recorded."""
        number = self._number(stamp)
        return None if number is None else self._tracks[number].world(stamp)

    def _number(self, stamp: float) -> int | None:
        found = (n for n, track in enumerate(self._tracks) if track.begin <= stamp <= track.end)
        return next(found, None)

    def chain(self, seconds: float) -> PlayedChain | None:
        """Return the chain under way, or the last one before; None before the first."""
        number = bisect.bisect_right(self.chains, seconds, key=lambda one: one.began)
        return self.chains[number - 1] if number else None

    def trail(self, begin: float, end: float, most: int) -> list[tuple[float, float]]:
        """Return at most `most` places (m) of the way between two times (s), after the last jump between."""
        (first, since), (track, until) = self._there(begin), self._there(end)
        times = track.odom[:, 0]
        earliest = bisect.bisect_left(times, since) if first is track else 0
        rows = track.odom[earliest : bisect.bisect_right(times, until)]
        rows = rows[:: max(1, -(-len(rows) // (most - 1)))]
        pose = track.pose(until)
        return [*((x, y) for x, y in rows[:, 1:3].tolist()), (pose.x, pose.y)]
