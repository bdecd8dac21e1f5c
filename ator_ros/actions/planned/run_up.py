"""Finds run-ups to a goal: a straight lead, one turn, and straight on until the ball is let go.

The heading of a shot is free, and so is the place between the posts: unlike a pose, which needs a turn at
either end, the mouth is met by a lead and a turn whose size decides where the ball will cross the line.
Every combination on a fine grid is tried, so that neighbouring starts find neighbouring run-ups.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np

from ator_ros.actions.planned.clearance import Obstacles, is_clear
from ator_ros.actions.planned.manoeuvre import Manoeuvre, Side
from ator_ros.actions.planned.profiles import straight_times, turn_times
from ator_ros.actions.planned.release import SLANT, release
from ator_ros.actions.planned.turns import Driving, displacement_table, speeds_after
from ator_ros.geometry import FloatArray, Pose, wrap_angles
from ator_ros.robot import Limits, Robot

_TRIES = 3000  # where the posts block so many, there is no room
_TURNS: FloatArray = math.radians(1.0) * np.arange(-300, 301, dtype=float)
_LEADS: FloatArray = np.array((0.0, 0.1, 0.2, 0.3, 0.45, 0.7, 1.0, 1.4))


def run_up(
    robot: Robot, start: Pose, mouth: Pose, entries: Sequence[Side], limits: Limits
) -> Manoeuvre | None:
    """Give the run-up with one turn that has the ball in the goal first; None where the posts block all.

    Parameters
    ----------
    start : Pose
        Pose of the axle.
    mouth : Pose
        Middle of the goal's mouth, heading out of the field.
    entries : sequence of Side
        How the lead and the turn may be driven; leads are also tried longer.
    """
    in_order = itertools.islice(_run_ups(robot, start, mouth, entries, limits), _TRIES)
    return next((found for found in in_order if is_clear(found, Obstacles(), robot)), None)


def _run_ups(
    robot: Robot, start: Pose, mouth: Pose, entries: Sequence[Side], limits: Limits
) -> Iterator[Manoeuvre]:
    """Give run-ups, fastest first."""
    seen = mouth.relative(start)
    headings = wrap_angles(seen.yaw + _TURNS)
    kept = np.flatnonzero(np.abs(headings) <= SLANT)
    turns, headings = _TURNS[kept], headings[kept]
    # One table for each speed: those for the speed of a start in motion, which are new, are few.
    groups = itertools.groupby((side.turn for side in entries), key=lambda turn: turn.speed)
    table = np.concatenate(
        [displacement_table(_TURNS, tuple(ways), limits)[:, :, kept] for _, ways in groups]
    )
    # Shapes from here on: (entries, leads, turns).
    length, outer, speed, acceleration, rate = np.array(
        [(side.length, side.outer_speed, *side.turn) for side in entries]
    ).T[:, :, None, None]
    leads = length + _LEADS[:, None]
    along, across = leads + table[:, 0, None], table[:, 1, None]
    c, s = math.cos(seen.yaw), math.sin(seen.yaw)
    x, y = seen.x + c * along - s * across, seen.y + s * along + c * across
    turning = turn_times(turns, rate, limits.aw)
    after = speeds_after(speed, acceleration, turning, limits.v)
    end = release(robot, x, y, headings, after, limits)
    times = straight_times(leads, outer, speed, limits) + turning + end.time
    found = np.nonzero(end.allowed)
    for which in np.argsort(times[found], kind="stable"):
        entry, lead, turn = at = tuple(int(axis[which]) for axis in found)
        side, distance, released = entries[entry], float(end.distance[at]), float(end.speed[at])
        last = Pose(float(x[at]), float(y[at]), float(headings[turn])).ahead(distance)
        yield Manoeuvre(
            start,
            mouth.compose(last),
            Side(float(leads[entry, lead, 0]), side.outer_speed, side.turn),
            Side(0.0, released, Driving(released, 0.0, limits.w)),
            float(turns[turn]),
            0.0,
            distance,
            limits,
        )
