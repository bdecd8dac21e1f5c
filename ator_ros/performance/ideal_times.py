"""How long ideal motions between two poses take: derived variables that grow with the work of an action.

They come from the direct variables and the robot's description alone, and know nothing of an action's state
or plan. But they are motions of the shape that our own actions drive best (turn while gaining speed, drive
straight, turn while losing speed, run straight to the goal), so much of what there is to learn is known to
them before. docs/ablation.md tells the accuracy with and without them, the evaluation what they would choose.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.performance.durations import change_distance, drive_time, forward_time, turn_time
from ator_ros.performance.families import Family
from ator_ros.performance.turns import HALF, STEP, TURNS, WIDEST, Indices

_WAY_ROUND = 6.0  # s per m that a straight drive passes too near the ball
_FULL_TURN = 2.0 * np.pi
_AT_ONCE = 128  # situations
_GRID = TURNS.astype(np.float32)
_COS, _SIN = np.cos(_GRID), np.sin(_GRID)
_OUTWARD = np.array([[1.0], [-1.0]])  # the last turn is driven from the goal
_MOST_TURNED = np.radians(450.0)


@dataclass(frozen=True)
class Motions:
    """The fastest motion of a family in each situation: arrays of shape (n,).

    Attributes
    ----------
    time : ndarray
        In s.
    turn : ndarray
        Sum of the angles of both turns in rad.
    """

    time: FloatArray
    turn: FloatArray

    def best_of(self, count: int) -> Motions:
        """Give the fastest of several motions in each of `count` situations, from shape (m * count,)."""
        if len(self.time) == count:
            return self
        best = self.time.reshape(-1, count).argmin(axis=0) * count + np.arange(count)
        return Motions(self.time[best], self.turn[best])

    def after(self, time: FloatArray) -> Motions:
        """Give the motions with `time` (s) before them."""
        return Motions(self.time + time, self.turn)


@dataclass(frozen=True)
class Ends:
    """Both ends of motions, in the frame of the start: arrays of shape (n,).

    Attributes
    ----------
    x, y : ndarray
        Destination of the axle in m.
    turn : ndarray
        Heading there in rad.
    speed, arrival : ndarray
        Forward speeds at the start and at the destination in m/s.
    """

    x: FloatArray
    y: FloatArray
    turn: FloatArray
    speed: FloatArray
    arrival: FloatArray


class _Found(NamedTuple):
    """Motions found.

    Attributes
    ----------
    cell, situation : ndarray of int, shape (m,)
        Where they are in arrays of shape (kinds, n), flattened, and in those of shape (n,).
    turns : ndarray, shape (2, m)
        First and last turn in rad.
    """

    cell: Indices
    situation: Indices
    turns: FloatArray


def fastest_motions(ends: Ends, family: Family, *, hold: float) -> Motions:
    """Give the fastest motion of `family` in each of n situations.

    Parameters
    ----------
    ends : Ends
        Starts and destinations.
    family : Family
        Which motions there are.
    hold : float
        Distance in m from the destination to the ball in front of it.
    """
    count = len(ends.x)
    if count > _AT_ONCE:  # more would not fit into the processor's cache
        cuts = range(_AT_ONCE, count, _AT_ONCE)
        columns = (np.split(getattr(ends, field.name), cuts) for field in dataclasses.fields(Ends))
        parts = [fastest_motions(Ends(*part), family, hold=hold) for part in zip(*columns, strict=True)]
        return Motions(
            *(np.concatenate([getattr(part, name) for part in parts]) for name in ("time", "turn"))
        )
    search = _Search(ends, family, hold)
    found = search.find()
    time = search.time(found)
    best, turn = np.full(len(ends.x), np.inf), np.empty(len(ends.x))
    np.minimum.at(best, found.situation, time)
    winner = np.flatnonzero(time == best.take(found.situation))
    turn[found.situation.take(winner)] = np.abs(found.turns.take(winner, axis=1)).sum(axis=0)
    missed = best == np.inf
    if missed.any():  # ends so near each other that no motion has room
        turned = 2.0 * np.pi if family.forward else np.pi
        best[missed] = 2.0 * turn_time(turned, family.limits.w, family.limits.aw)
        turn[missed] = 2.0 * turned
    return Motions(best, turn)


class _Search:
    """The motions of a family in n situations; its arrays have the shape (kinds, n).

    Parameters
    ----------
    ends, family, hold
        As for `fastest_motions`.
    """

    def __init__(self, ends: Ends, family: Family, hold: float) -> None:
        kinds, limits = family.columns, family.limits
        self.ends, self.family, self.kinds = ends, family, kinds
        self.limits, self.tables = limits, family.tables
        self.cos, self.sin = np.cos(ends.turn), np.sin(ends.turn)
        self.junction, self.run = self._before_run()
        self.speed = np.where(np.isnan(kinds.entry), ends.speed, kinds.entry)
        gain = self.speed - ends.speed
        leading = np.maximum(gain * (1.0 / limits.a), gain * (-1.0 / limits.brake))
        lead = 0.5 * (self.speed + ends.speed) * leading
        self.ends_time = leading + forward_time(self.run, self.junction, ends.arrival, limits)
        # From where the first turn begins to where the last one ends.
        self.x = ends.x - lead - self.run * self.cos
        self.y = np.broadcast_to(ends.y - self.run * self.sin, self.x.shape)
        self.ball_x, self.ball_y = ends.x + hold * self.cos - lead, ends.y + hold * self.sin
        self.first_row = self.tables.rows(kinds.first_way, self.speed)
        self.last_row = self.tables.rows(kinds.last_way, self.junction)

    def _before_run(self) -> tuple[FloatArray, FloatArray]:
        """Give speed (m/s) and distance (m) to the goal where the straight run begins."""
        limits, run, arrival, share = self.limits, self.family.run, self.ends.arrival, self.kinds.share
        square = arrival * arrival
        if run is None:
            junction = share * limits.v + np.zeros_like(arrival)
            change = junction * junction - square
            return junction, np.maximum(change * (0.5 / limits.brake), change * (-0.5 / limits.a))
        greatest = np.minimum(np.sqrt(square + 2.0 * limits.brake * run), limits.v)
        least = np.sqrt(np.maximum(square - 2.0 * limits.a * run, 0.0))
        return least + share * (greatest - least), np.full_like(arrival, run)

    def find(self) -> _Found:
        """Find the motions whose straight drive meets the last turn.

        The heading of the drive is the only unknown. Its roots are bracketed on a grid of first turns, where
        the parts of both turns just add; the whole change of heading may go either way round.
        """
        total = self._changes_of_heading()
        ways = total.shape[1]
        x, y = (side.astype(np.float32)[:, :, None] for side in (self.x, self.y))
        lane = y * _COS - x * _SIN - self.tables.brackets[self.first_row]
        gap = lane[:, :, None] - self.tables.across_from(self.last_row[:, :, None], -total)
        # The gap falls through zero where the drive then goes forward, and rises where it goes backward.
        above = gap * self.kinds.direction[:, :, None, None] > 0.0
        place = np.flatnonzero(above[..., :-1] & ~above[..., 1:])
        row = place // (2 * HALF)
        flat = place + row  # a row of gaps is longer by one
        before, after = gap.take(flat), gap.take(flat + 1)
        first = TURNS.take(place - row * (2 * HALF)) + STEP * (before / (before - after))
        cell = row // ways
        situation = cell % len(self.ends.x)
        last = total.take(situation * ways + row % ways) - first
        turns = np.array((first, last))
        likely = np.flatnonzero((np.abs(last) < WIDEST) & (np.abs(turns).sum(axis=0) < _MOST_TURNED))
        return _Found(cell.take(likely), situation.take(likely), turns.take(likely, axis=1))

    def _changes_of_heading(self) -> FloatArray:
        """Give the sums of both turns in rad, shape (n, ways): either way round, or a circle more."""
        turn = self.ends.turn
        ways = [turn, turn - np.copysign(_FULL_TURN, turn)]
        if self.family.forward:
            ways.append(turn + np.copysign(_FULL_TURN, turn))
        return np.stack(ways, axis=1)

    def time(self, found: _Found) -> FloatArray:
        """Give the times in s of motions, infinite for those that are not allowed, shape (m,)."""
        cell, at, turns = found
        limits, tables, ends = self.limits, self.tables, self.ends
        first = turns[0]
        cos, sin = np.cos(first), np.sin(first)
        rows = np.array((self.first_row.take(cell), self.last_row.take(cell)))
        places = tables.place(rows, turns * _OUTWARD)
        begun, ending = tables.at(tables.along, places)
        length = cos * self.x.take(cell) + sin * self.y.take(cell) - begun - ending
        kind = cell // len(ends.x)
        turning = turn_time(np.abs(turns), self.kinds.rates.take(kind, axis=1), limits.aw)
        speeds = np.array((self.speed.take(cell), self.junction.take(cell)))
        speeds += self.kinds.changes.take(kind, axis=1) * turning
        before, after = np.minimum(np.maximum(speeds, -limits.v), limits.v)
        result = turning.sum(axis=0) + self.ends_time.take(cell)
        if self.family.forward:
            result += forward_time(length, before, after, limits)
            result[length < change_distance(before, after, limits)] = np.inf
        else:
            result += drive_time(length, before, after, limits)
        if self.family.passing:
            left, _ = tables.at(tables.across, places)
            x, y = self.ball_x.take(cell), self.ball_y.take(at)
            along, beside = cos * x + sin * y - begun, cos * y - sin * x - left
            passed = (along > np.minimum(length, 0.0)) & (along < np.maximum(length, 0.0))
            result += _WAY_ROUND * np.maximum(self.family.passing - np.abs(beside), 0.0) * passed
        return np.asarray(result)
