"""Finds run-ups to a goal: a straight lead, one turn, and straight on until the ball is let go.

The heading of a shot is free, and so is the place between the posts: unlike a pose, which needs a turn at
either end, the mouth is met by a lead and a turn whose size decides where the ball will cross the line.
Every combination on a fine grid is tried, so that neighbouring starts find neighbouring run-ups.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ator_ros.domains.soccer.planned.clearance import Obstacles, is_clear
from ator_ros.domains.soccer.planned.release import SLANT, may_score, release
from ator_ros.domains.soccer.planned.screening import look_points, portions, screening_points, touching
from ator_ros.geometry import FloatArray, Pose, wrap_angles
from ator_ros.motion.displacements import TurnDriving, displacement_table, speeds_after
from ator_ros.motion.durations import drive_time, turn_time
from ator_ros.motion.manoeuvre import Bundle, Manoeuvre, Side, side_table
from ator_ros.motion.planning import Planning
from ator_ros.robot.description import Limits, Robot

_BLOCK = 16  # entries in a portion of work
_TRIES = 3000  # where the posts block so many, there is no room
_TABLE_POINTS = 20
_RUN_UPS_A_POINT = 2_200
_TURNS: FloatArray = math.radians(1.0) * np.arange(-300, 301, dtype=float)
_LEADS: FloatArray = np.array((0.0, 0.1, 0.2, 0.3, 0.45, 0.7, 1.0, 1.4))


def run_up(
    robot: Robot, start: Pose, mouth: Pose, entries: Sequence[Side], limits: Limits
) -> Planning[Manoeuvre | None]:
    """Plan the run-up with one turn that has the ball in the goal first; None where the posts block all.

    Parameters
    ----------
    start : Pose
        Pose of the axle.
    mouth : Pose
        Middle of the goal's mouth, heading out of the field.
    entries : sequence of Side
        How the lead and the turn may be driven; leads are also tried longer.
    """
    found = yield from _run_ups(robot, start, mouth, entries, limits)
    obstacles = Obstacles()
    for which in portions(np.arange(len(found)), found.times):
        touches = np.zeros(len(which), dtype=bool)
        if len(which) > 1:
            yield screening_points(found.times[which])
            touches = touching(found.bundle(which), obstacles, robot)
        for index in which[~touches]:
            yield look_points(found.times[index])
            manoeuvre = found.manoeuvre(int(index))
            if is_clear(manoeuvre, obstacles, robot):
                return manoeuvre
    return None


@dataclass(frozen=True, slots=True)
class _RunUps:
    """Run-ups, fastest first.

    Attributes
    ----------
    sides : ndarray, shape (5, n)
        The numbers of the leads and turns, as in `Bundle`.
    straights : ndarray, shape (3, n)
        Where the last straights begin, seen from the mouth (m, rad).
    turns, distances, released : ndarray, shape (n,)
        Turn in rad, length of the straight in m, speed at its end in m/s.
    times : ndarray, shape (n,)
        Until the ball is in the goal, in s.
    """

    start: Pose
    mouth: Pose
    limits: Limits
    sides: FloatArray
    straights: FloatArray
    turns: FloatArray
    distances: FloatArray
    released: FloatArray
    times: FloatArray

    def __len__(self) -> int:
        return len(self.times)

    def bundle(self, which: NDArray[np.intp]) -> Bundle:
        """Return the manoeuvres of the indices `which`, shape (n,)."""
        released, distance, mouth = self.released[which], self.distances[which], self.mouth
        x, y, heading = self.straights[:, which]
        x, y = x + distance * np.cos(heading), y + distance * np.sin(heading)
        c, s = math.cos(mouth.yaw), math.sin(mouth.yaw)
        goals = np.stack((mouth.x + c * x - s * y, mouth.y + s * x + c * y, mouth.yaw + heading))
        nothing = np.zeros(len(which))
        exits = np.stack((nothing, released, released, nothing, np.full(len(which), self.limits.w)))
        return Bundle(
            self.start, goals, self.sides[:, which], exits, self.turns[which], nothing, distance, self.limits
        )

    def manoeuvre(self, index: int) -> Manoeuvre:
        """Return one of them."""
        length, outer, *turn = self.sides[:, index].tolist()
        released, distance = float(self.released[index]), float(self.distances[index])
        last = Pose(*self.straights[:, index].tolist()).ahead(distance)
        return Manoeuvre(
            self.start,
            self.mouth.compose(last),
            Side(length, outer, TurnDriving(*turn)),
            Side(0.0, released, TurnDriving(released, 0.0, self.limits.w)),
            float(self.turns[index]),
            0.0,
            distance,
            self.limits,
        )


def _run_ups(
    robot: Robot, start: Pose, mouth: Pose, entries: Sequence[Side], limits: Limits
) -> Planning[_RunUps]:
    """Find the `_TRIES` fastest run-ups on the grid."""
    yield _TABLE_POINTS
    seen = mouth.relative(start)
    kept = np.flatnonzero(np.abs(wrap_angles(seen.yaw + _TURNS)) <= SLANT)
    table, sides = _turns_table(entries, limits, kept), side_table(entries)
    points = 1 + _BLOCK * len(_LEADS) * len(kept) // _RUN_UPS_A_POINT
    columns, latest = np.zeros((12, 0)), math.inf
    for first in range(0, len(entries), _BLOCK):
        yield points
        block = slice(first, first + _BLOCK)
        found = _of_sides(robot, seen, sides[:, block], table[block], _TURNS[kept], limits, latest)
        columns = np.concatenate((columns, found), axis=1)
        if columns.shape[1] > _TRIES:
            latest = float(np.partition(columns[-1], _TRIES - 1)[_TRIES - 1])
            columns = columns[:, columns[-1] <= latest]
    columns = columns[:, np.argsort(columns[-1], kind="stable")[:_TRIES]]
    return _RunUps(start, mouth, limits, columns[:5], columns[5:8], *columns[8:])


def _turns_table(entries: Sequence[Side], limits: Limits, kept: NDArray[np.intp]) -> FloatArray:
    """Return where turns end, shape (entries, 2, kept); tables at the start's own speed are not stored."""
    tables = []
    for speed, group in itertools.groupby(entries, key=lambda side: side.turn.speed):
        ways = tuple(side.turn for side in group)
        own = speed == entries[0].outer_speed
        tables.append(
            displacement_table(_TURNS, ways, limits, kept) if own else _kept_table(ways, limits)[:, :, kept]
        )
    return np.concatenate(tables)


@lru_cache(maxsize=64)
def _kept_table(ways: tuple[TurnDriving, ...], limits: Limits) -> FloatArray:
    return displacement_table(_TURNS, ways, limits)


def _of_sides(
    robot: Robot,
    seen: Pose,
    sides: FloatArray,
    table: FloatArray,
    turns: FloatArray,
    limits: Limits,
    latest: float,
) -> FloatArray:
    """Find run-ups of up to `latest` s with some of the sides, shape (12, n), in the order of `_RunUps`."""
    headings = wrap_angles(seen.yaw + turns)
    length, outer, speed, acceleration, rate = sides[:, :, None]
    leads = length + _LEADS
    lead_times, turning = drive_time(leads, outer, speed, limits), turn_time(turns, rate, limits.aw)
    after = speeds_after(speed, acceleration, turning, limits.v)
    c, s = math.cos(seen.yaw), math.sin(seen.yaw)
    x, y = seen.x + c * table[:, 0] - s * table[:, 1], seen.y + s * table[:, 0] + c * table[:, 1]
    likely = may_score(robot, x, y, headings, seen.yaw, leads)
    if math.isfinite(latest):
        likely &= lead_times[:, :, None] + turning[:, None] <= latest
    entry, lead, turn = np.nonzero(likely)
    along, across = leads[entry, lead] + table[entry, 0, turn], table[entry, 1, turn]
    x, y = seen.x + c * along - s * across, seen.y + s * along + c * across
    end = release(robot, x, y, headings[turn], after[entry, turn], limits)
    times = lead_times[entry, lead] + turning[entry, turn] + end.time
    found = np.flatnonzero(end.allowed & (times <= latest))
    entry, lead, turn = entry[found], lead[found], turn[found]
    picked = sides[:, entry]
    picked[0] = leads[entry, lead]
    return np.stack((*picked, x[found], y[found], headings[turn], turns[turn],
                     end.distance[found], end.speed[found], times[found]))  # fmt: skip
