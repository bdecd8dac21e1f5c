"""How long ideal motions between two poses take: derived variables that grow with the work of an action.

They come from the direct variables and the robot's limits alone. What an action plans is its own affair:
these motions (turn while gaining speed, drive straight, turn while losing speed, run straight to the goal)
only share the limits of the base with it.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.performance.families import Family
from ator_ros.performance.turns import RealArray
from ator_ros.robot import Limits

ITERATIONS = 3
_STEP = 0.6  # rad by which an iteration changes the first turn at most
_GRAIN = 0.02  # rad
_BACKWARD = 5.0  # s per m that the straight drive would have to go against its direction
_MISSED = 5.0  # s per m by which a motion misses the goal sideways
_WAY_ROUND = 6.0  # s per m that a straight drive passes too near the ball
_FULL_TURN = 2.0 * np.pi


def turn_time(angle: FloatArray, limits: Limits) -> FloatArray:
    """Give the time in s of turns on the spot by `angle` (rad, not negative), from rest to rest."""
    ramped = limits.w * limits.w / limits.aw
    short = 2.0 * np.sqrt(np.minimum(angle, ramped) / limits.aw)
    result: FloatArray = short + np.maximum(angle - ramped, 0.0) / limits.w
    return result


def drive_time(distance: RealArray, before: RealArray, after: RealArray, limits: Limits) -> RealArray:
    """Give the time in s of straight drives over `distance` (m) between two speeds (m/s).

    A distance too short for the change of speed takes the time of that change.
    """
    a, brake = limits.a, limits.brake
    before2, after2 = before * before, after * after
    peak2 = (2.0 * a * brake * distance + brake * before2 + a * after2) * (1.0 / (a + brake))
    peak2 = np.maximum(np.minimum(peak2, limits.v * limits.v), np.maximum(before2, after2))
    peak = np.sqrt(peak2)
    cruise = distance - (peak2 - before2) * (0.5 / a) - (peak2 - after2) * (0.5 / brake)
    ramps = (peak - before) * (1.0 / a) + (peak - after) * (1.0 / brake)
    result: RealArray = ramps + np.maximum(cruise, 0.0) * (1.0 / limits.v)
    return result


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

    x: RealArray
    y: RealArray
    turn: RealArray
    speed: RealArray
    arrival: RealArray


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
    single = Ends(*(getattr(ends, field.name).astype(np.float32) for field in dataclasses.fields(Ends)))
    search = _Search(single, family, hold)
    first, total = search.first_guess()
    first = search.solve(first, total)
    last = total - first
    time = search.time(first, last)
    best, each = time.argmin(axis=0), np.arange(time.shape[1])
    turn = np.abs(first[best, each]) + np.abs(last[best, each])
    return Motions(time[best, each].astype(np.float64), turn.astype(np.float64))


class _Search:
    """The motions of a family in n situations; its arrays have the shape (kinds, n).

    Parameters
    ----------
    ends, family, hold
        As for `fastest_motions`.
    """

    def __init__(self, ends: Ends, family: Family, hold: float) -> None:
        kinds = family.columns
        self.ends, self.family, self.kinds, self.hold = ends, family, kinds, hold
        self.limits, self.tables = family.limits, family.tables
        self.cos, self.sin = np.cos(ends.turn), np.sin(ends.turn)
        self.junction, self.run = self._before_run()
        self.speed = np.maximum(ends.speed, kinds.entry)
        lead = (self.speed - ends.speed) * (self.speed + ends.speed) * (0.5 / self.limits.a)
        # All is seen from where the first turn begins.
        self.goal_x, self.goal_y = ends.x - lead - self.run * self.cos, ends.y - self.run * self.sin
        self.first_row = self.tables.rows(kinds.first_way, self.speed)
        self.last_row = self.tables.rows(kinds.last_way, self.junction)

    def _before_run(self) -> tuple[RealArray, RealArray]:
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

    def first_guess(self) -> tuple[RealArray, RealArray]:
        """Give the first turn and the sum of both turns (rad) where turns are arcs of circles."""
        kinds, radius = self.kinds, self.family.radius
        first_radius, last_radius = radius * kinds.first_side, radius * kinds.last_side
        # From centre to centre; in reverse the world is seen turned by half a turn about the start.
        to_x = kinds.direction * self.goal_x - last_radius * self.sin
        to_y = kinds.direction * self.goal_y + last_radius * self.cos - first_radius
        offset = last_radius - first_radius
        tangent = np.sqrt(np.maximum(to_x * to_x + to_y * to_y - offset * offset, 0.0))
        heading = np.arctan2(to_y * tangent - to_x * offset, to_x * tangent + to_y * offset)
        first = kinds.first_side * _within_turn(kinds.first_side * heading)
        return first, first + kinds.last_side * _within_turn(kinds.last_side * (self.ends.turn - heading))

    def _drive(self, first: RealArray, last: RealArray) -> tuple[RealArray, ...]:
        """Give where the first turn ends, and the way from there to where the last one begins, in m."""
        tables = self.tables
        first_at, last_at = self.first_row + tables.columns(first), self.last_row + tables.columns(-last)
        begin_x, begin_y = tables.ahead.take(first_at), tables.left.take(first_at)
        back_x, back_y = tables.ahead.take(last_at), tables.left.take(last_at)
        to_x = self.goal_x - begin_x - (self.cos * back_x - self.sin * back_y)
        to_y = self.goal_y - begin_y - (self.sin * back_x + self.cos * back_y)
        return begin_x, begin_y, to_x, to_y

    def solve(self, first: RealArray, total: RealArray) -> RealArray:
        """Give the first turns (rad) whose drives meet the last turns, by the secant method."""
        before = gap_before = first
        for iteration in range(ITERATIONS):
            _, _, to_x, to_y = self._drive(first, total - first)
            cos, sin = np.cos(first), np.sin(first)
            gap = cos * to_y - sin * to_x
            along = cos * to_x + sin * to_y
            change = gap / np.where(along == 0.0, 1.0, along)
            if iteration == 0:
                change *= 0.5
            else:
                step, slope = first - before, gap_before - gap
                # After a small step the tables' grain, not the geometry, would make the secant's slope.
                steep = (np.abs(step) > _GRAIN) & (slope != 0.0)
                change = np.where(steep, gap * step / np.where(steep, slope, 1.0), change)
            before, gap_before = first, gap
            first = first + np.minimum(np.maximum(change, -_STEP), _STEP)
        return first

    def time(self, first: RealArray, last: RealArray) -> RealArray:
        """Give the times in s of motions with these turns (rad), and of what they lack, shape (kinds, n)."""
        begin_x, begin_y, to_x, to_y = self._drive(first, last)
        cos, sin = np.cos(first), np.sin(first)
        length = cos * to_x + sin * to_y
        result = self._moving_time(first, last, self.kinds.direction * length)
        result += _MISSED * np.abs(cos * to_y - sin * to_x)
        if self.family.passing:
            x, y = self.ends.x + self.hold * self.cos - begin_x, self.ends.y + self.hold * self.sin - begin_y
            along, beside = cos * x + sin * y, np.abs(cos * y - sin * x)
            passes = (along > np.minimum(length, 0.0)) & (along < np.maximum(length, 0.0))
            result += _WAY_ROUND * np.maximum(self.family.passing - beside, 0.0) * passes
        return result

    def _moving_time(self, first: RealArray, last: RealArray, length: RealArray) -> RealArray:
        """Give the times in s of motions whose straight drive is `length` m long in its direction."""
        limits, tables, kinds = self.limits, self.tables, self.kinds
        first_time = tables.time.take(kinds.first_way * tables.angles + tables.columns(first))
        last_time = tables.time.take(kinds.last_way * tables.angles + tables.columns(last))
        before = kinds.direction * (self.speed + kinds.first_change * first_time)
        after = kinds.direction * (self.junction + kinds.last_change * last_time)
        # Speeds against the direction of the drive have to be lost first.
        wrong = np.minimum(before, 0.0) + np.minimum(after, 0.0)
        before, after = (np.minimum(np.maximum(speed, 0.0), limits.v) for speed in (before, after))
        driving = drive_time(np.maximum(length, 0.0), before, after, limits)
        running = drive_time(self.run, self.junction, self.ends.arrival, limits)
        leading = (self.speed - self.ends.speed) * (1.0 / limits.a)
        result: RealArray = leading + first_time + last_time + driving + running
        result -= wrong * (1.0 / limits.a) + _BACKWARD * np.minimum(length, 0.0)
        return result


def _within_turn(angle: RealArray) -> RealArray:
    """Give the same angle in [0, 2 pi)."""
    result: RealArray = angle - _FULL_TURN * np.floor(angle * (1.0 / _FULL_TURN))
    return result
