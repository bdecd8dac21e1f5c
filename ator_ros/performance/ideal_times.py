"""How long ideal motions between two poses take: derived variables that grow with the work of an action.

They come from the direct variables and the robot's limits alone. What an action plans is its own affair:
these paths (an arc, a straight line, an arc, a straight run-in) only share the limits of the base with it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ator_ros.geometry import FloatArray
from ator_ros.robot import Limits

_WAY_ROUND = 6.0  # s per m that a straight line passes too near the ball
_IMPOSSIBLE = 50.0  # s added where two circles have no common tangent
_FULL_TURN = 2.0 * np.pi


def turn_time(angle: FloatArray, limits: Limits) -> FloatArray:
    """Give the time in s of turns on the spot by `angle` (rad, not negative), from rest to rest."""
    ramped = limits.w * limits.w / limits.aw
    short = 2.0 * np.sqrt(np.minimum(angle, ramped) / limits.aw)
    result: FloatArray = short + np.maximum(angle - ramped, 0.0) / limits.w
    return result


def drive_time(distance: FloatArray, before: FloatArray, after: FloatArray, limits: Limits) -> FloatArray:
    """Give the time in s of straight drives over `distance` (m) between two speeds (m/s).

    A distance too short for the change of speed takes the time of that change.
    """
    a, brake = limits.a, limits.brake
    before2, after2 = before * before, after * after
    peak2 = (2.0 * a * brake * distance + brake * before2 + a * after2) / (a + brake)
    peak2 = np.maximum(np.minimum(peak2, limits.v * limits.v), np.maximum(before2, after2))
    peak = np.sqrt(peak2)
    cruise = distance - (peak2 - before2) * (0.5 / a) - (peak2 - after2) * (0.5 / brake)
    result: FloatArray = (peak - before) / a + (peak - after) / brake + np.maximum(cruise, 0.0) / limits.v
    return result


def _reached(speed: FloatArray, distance: FloatArray, bound: FloatArray, change: float) -> FloatArray:
    """Give the speed in m/s after a `change` (m/s^2) over `distance` from `speed`, at most `bound`."""
    result: FloatArray = np.minimum(np.sqrt(speed * speed + 2.0 * change * distance), bound)
    return result


@dataclass(frozen=True)
class PathFamily:
    """A family of paths: the radii in m of first and last arc, and whether they may be driven in reverse.

    Attributes
    ----------
    first, last : tuple of float
        Radii; 0 turns on the spot.
    reverse : bool
        Also drive backward up to the run-in.
    run_in : float
        Straight stretch in m at the end of an approach to the ball.
    passing : float
        Distance in m that a straight line keeps from the ball in an approach.
    """

    first: tuple[float, ...]
    last: tuple[float, ...]
    reverse: bool
    run_in: float = 0.0
    passing: float = 0.0

    def variants(self) -> tuple[FloatArray, FloatArray, NDArray[np.float64]]:
        """Give signed radii of both arcs (left positive) and directions, each of shape (variants, 1)."""
        rows = [
            (first, last, direction)
            for direction in ((1.0, -1.0) if self.reverse else (1.0,))
            for first in _signed(self.first)
            for last in _signed(self.last if direction > 0.0 or not self.run_in else (0.0,))
        ]
        first, last, directions = np.array(rows).T[:, :, None]
        return first, last, directions


def _signed(radii: tuple[float, ...]) -> list[float]:
    return [sign * radius for radius in radii for sign in ((1.0, -1.0) if radius else (1.0,))]


DRIVE = PathFamily(first=(0.0, 0.3), last=(0.0, 0.3, 0.6), reverse=True, run_in=0.25, passing=0.4)
"""Driving without the ball, or up to it."""

DRIBBLE = PathFamily(first=(0.25, 0.5), last=(0.3, 0.6), reverse=False)
"""Driving with the ball: forward only, and no turns on the spot."""


@dataclass(frozen=True)
class Paths:
    """The fastest path of a family for each situation: arrays of shape (n,).

    Attributes
    ----------
    time : ndarray
        In s.
    turn : ndarray
        Sum of the angles of both arcs in rad.
    """

    time: FloatArray
    turn: FloatArray


def fastest_paths(
    along: FloatArray,
    across: FloatArray,
    turn: FloatArray,
    speed: FloatArray,
    arrival: FloatArray,
    approach: FloatArray,
    hold: float,
    family: PathFamily,
    limits: Limits,
) -> Paths:
    """Give the fastest path of `family` in each of n situations.

    Parameters
    ----------
    along, across, turn : ndarray, shape (n,)
        Destination of the axle as seen from the start: m forward, m to the left, rad.
    speed, arrival : ndarray, shape (n,)
        Forward speed at the start and at the destination in m/s.
    approach : ndarray, shape (n,)
        1 where a ball lies in front of the destination, else 0.
    hold : float
        Distance in m of that ball from the axle.
    family : PathFamily
        Which paths there are.
    limits : Limits
        Of speeds and accelerations.
    """
    first, last, direction = family.variants()
    cos, sin = np.cos(turn), np.sin(turn)
    run_in = family.run_in * approach
    # Driving in reverse is driving forward with the world turned by half a turn about the start.
    goal_x = direction * (along - run_in * cos)
    goal_y = direction * (across - run_in * sin)
    # From centre to centre of the circles; the tangent's heading follows without a further angle.
    to_x = goal_x - last * sin
    to_y = goal_y + last * cos - first
    offset = last - first
    square = np.maximum(to_x * to_x + to_y * to_y, 1e-9)
    free = square - offset * offset
    length = np.sqrt(np.maximum(free, 0.0))
    heading_x = (to_x * length + to_y * offset) / square
    heading_y = (to_y * length - to_x * offset) / square
    heading = np.arctan2(heading_y, heading_x)
    opening = _arc(heading, first)
    closing = _arc(turn - heading, last)
    time = _path_time(opening, length, closing, first, last, direction * speed, arrival, run_in, limits)
    time += np.where(free < 0.0, _IMPOSSIBLE, 0.0)
    if family.passing:
        ball_x = direction * (along + hold * cos) - first * heading_y
        ball_y = direction * (across + hold * sin) - first * (1.0 - heading_x)
        beside = np.abs(ball_y * heading_x - ball_x * heading_y)
        ahead = ball_x * heading_x + ball_y * heading_y
        near = np.maximum(family.passing - beside, 0.0) * ((ahead > 0.0) & (ahead < length + 0.1))
        time += _WAY_ROUND * near * approach
    best = time.argmin(axis=0)
    each = np.arange(len(turn))
    return Paths(time[best, each], (opening + closing)[best, each])


def _arc(angle: FloatArray, radius: FloatArray) -> FloatArray:
    """Give the angle (rad, 0 to 2 pi) to drive on a circle of signed radius; the shorter turn on the spot."""
    turned = np.where(radius < 0.0, -angle, angle)
    turned = turned - _FULL_TURN * np.floor(turned / _FULL_TURN)
    return np.where(radius == 0.0, np.minimum(turned, _FULL_TURN - turned), turned)


def _path_time(
    opening: FloatArray,
    length: FloatArray,
    closing: FloatArray,
    first: FloatArray,
    last: FloatArray,
    speed: FloatArray,
    arrival: FloatArray,
    run_in: FloatArray,
    limits: Limits,
) -> FloatArray:
    """Give the times in s of paths, shape (variants, n)."""
    outer, inner = np.abs(first), np.abs(last)
    turn_first, turn_last = turn_time(opening, limits), turn_time(closing, limits)
    # The speed at which the arc's turn takes as long as its length: none on the spot.
    bound_first = np.minimum(outer * opening / np.maximum(turn_first, 1e-6), limits.v)
    bound_last = np.minimum(inner * closing / np.maximum(turn_last, 1e-6), limits.v)
    bound_first = np.where((opening < 1e-3) & (outer > 0.0), limits.v, bound_first)
    bound_last = np.where((closing < 1e-3), limits.v, bound_last)
    start = np.minimum(np.maximum(speed, 0.0), bound_first)
    stopping = (np.maximum(-speed, 0.0) + np.maximum(speed, 0.0) - start) / limits.a
    end = np.minimum(_reached(arrival, run_in, bound_last, limits.brake), bound_last)
    after = _reached(start, outer * opening, bound_first, limits.a)
    before = _reached(end, inner * closing, bound_last, limits.brake)
    time_first = np.maximum(2.0 * outer * opening / np.maximum(start + after, 0.05), turn_first)
    time_last = np.maximum(2.0 * inner * closing / np.maximum(before + end, 0.05), turn_last)
    result: FloatArray = (
        stopping
        + time_first
        + drive_time(length, after, before, limits)
        + time_last
        + drive_time(run_in, end, arrival, limits)
    )
    return result
