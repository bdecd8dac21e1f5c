"""Fans of Bezier curves: every combination of start, handles, bump and tail that leads to a goal."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

import numpy as np

from ator_ros.actions.bezier.curve import TAIL_SAMPLES, Paths, as_row, bezier_paths, left_of
from ator_ros.geometry import FloatArray, Pose, wrap_angles

RUN_IN = 0.4
"""Length in m of the straight line that leads to a ball, or to where one is put."""

# A handle of a third of the distance makes the lateral error vanish with its square.
_SHARE = 1.0 / 3.0
_BUMPS = (0.0, 0.8, -0.8, 1.8, -1.8)
_LEAST_RUN_IN = 0.02
_CORNER = 0.6
_SAME_PLACE = 0.1


class Maneuver(enum.Enum):
    """What comes before the curve: nothing, a turn on the spot, or backing up straight."""

    FOLLOW = "follow"
    TURN = "turn"
    BACK_UP = "back up"


@dataclass(frozen=True, slots=True)
class Fan:
    """Curves after the same maneuver.

    Attributes
    ----------
    maneuver : Maneuver
        What comes first.
    starts : array, shape (n, 3)
        Poses in m and rad in which the curves begin.
    paths : Paths
        The curves, n of them.
    before : array, shape (n,)
        Time in s that the maneuver takes.
    """

    maneuver: Maneuver
    starts: FloatArray
    paths: Paths
    before: FloatArray


@dataclass(frozen=True, slots=True)
class _Tail:
    """The way from the end of a curve to the goal: straight, or round a quarter circle from a side."""

    end: Pose
    points: FloatArray
    bumps: tuple[float, ...]


def run_in_length(rel: Pose) -> float:
    """Give the length in m of the straight line to aim for, from the robot's pose in the goal's frame.

    It shrinks as a robot that is about in line comes near, so that the curve before it never gets tight.
    """
    if abs(rel.y) < 0.15 and abs(rel.yaw) < 0.6 and rel.x < 0.0:
        return min(RUN_IN, max(-rel.x - 0.5, 0.0))
    return RUN_IN


def fan(
    pose: Pose, target: Pose, *, run_in: float, outs: tuple[float, ...], ins: tuple[float, ...], corners: bool
) -> Fan:
    """Give every curve from `pose` in its direction.

    Parameters
    ----------
    pose, target : Pose
        Start and goal of the axle.
    run_in : float
        Length in m of the straight line before the goal.
    outs, ins : tuple of float
        Handles in m to choose from at both ends, besides a third of the distance.
    corners : bool
        Whether to come from the sides too, round a quarter circle.
    """
    rows = []
    for tail in _tails(target, run_in, corners):
        share = _SHARE * pose.distance(tail.end)
        rows += [(tail, o, i, b) for o in (share, *outs) for i in (share, *ins) for b in tail.bumps]
    starts = np.tile(as_row(pose), (len(rows), 1))
    return _fan(Maneuver.FOLLOW, starts, rows, target, np.zeros(len(rows)))


def turned_fan(
    maneuver: Maneuver,
    pose: Pose,
    target: Pose,
    *,
    run_in: float,
    ins: tuple[float, ...],
    before: float,
    turn_speed: float,
) -> Fan:
    """Give curves from `pose` after a turn on the spot into each.

    Parameters
    ----------
    maneuver : Maneuver
        What comes first.
    pose, target : Pose
        Start of the turn, and goal of the axle.
    run_in : float
        Length in m of the straight line before the goal.
    ins : tuple of float
        Handles in m to choose from at the end, besides a third of the distance.
    before, turn_speed : float
        Time in s to add for the maneuver, and rad/s at which it turns.
    """
    rows, headings = [], []
    for tail in _tails(target, run_in, True):
        share = _SHARE * pose.distance(tail.end)
        for into in (share, *ins):
            for bump in tail.bumps:
                rows.append((tail, share, into, bump))
                headings.append(_first_heading(pose, tail.end, into, bump))
    if pose.distance(target) < _SAME_PLACE:
        headings = [
            target.yaw if row[0].end.yaw == target.yaw else heading
            for row, heading in zip(rows, headings, strict=True)
        ]
    turns = np.abs(wrap_angles(np.array(headings) - pose.yaw))
    starts = np.stack([np.full(len(rows), pose.x), np.full(len(rows), pose.y), np.array(headings)], axis=1)
    return _fan(maneuver, starts, rows, target, before + turns / turn_speed)


def _fan(
    maneuver: Maneuver,
    starts: FloatArray,
    rows: list[tuple[_Tail, float, float, float]],
    target: Pose,
    before: FloatArray,
) -> Fan:
    paths = bezier_paths(
        starts,
        np.array([row[0].end for row in rows]),
        np.array([row[1:3] for row in rows]),
        np.array([row[3] for row in rows]),
        np.stack([row[0].points for row in rows]),
        np.full(len(rows), target.yaw),
    )
    return Fan(maneuver, starts, paths, before)


def _first_heading(pose: Pose, end: Pose, into: float, bump: float) -> float:
    """Give the direction in rad in which a curve with this last handle and bump begins most naturally."""
    third = end.ahead(-into)
    x, y = third.x, third.y
    if bump != 0.0:
        chord = np.array([[end.x - pose.x, end.y - pose.y]])
        left = left_of(chord, np.array([[math.cos(end.yaw), math.sin(end.yaw)]]))[0]
        x = (pose.x + third.x) / 2 + 0.5 * bump * float(left[0])
        y = (pose.y + third.y) / 2 + 0.5 * bump * float(left[1])
    return math.atan2(y - pose.y, x - pose.x)


def _tails(target: Pose, run_in: float, corners: bool) -> list[_Tail]:
    run_in = max(run_in, _LEAST_RUN_IN)
    along = np.linspace(-run_in, 0.0, TAIL_SAMPLES + 1)[1:]
    local = np.stack([along, np.zeros(TAIL_SAMPLES)], axis=1)
    tails = [_Tail(target.ahead(-run_in), _placed(local, target), _BUMPS)]
    for side in (1.0, -1.0) if corners else ():
        angles = np.linspace(0.0, math.pi / 2, TAIL_SAMPLES)[1:]
        arc = np.stack([-run_in - _CORNER * np.cos(angles), side * _CORNER * (1 - np.sin(angles))], axis=1)
        end = target.compose(Pose(-run_in - _CORNER, side * _CORNER, -side * math.pi / 2))
        tails.append(_Tail(end, _placed(np.concatenate([arc, [[0.0, 0.0]]]), target), (0.0,)))
    return tails


def _placed(local: FloatArray, frame: Pose) -> FloatArray:
    c, s = math.cos(frame.yaw), math.sin(frame.yaw)
    return np.asarray(local @ np.array([[c, s], [-s, c]]) + np.array([frame.x, frame.y]))
