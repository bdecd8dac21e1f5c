"""Many manoeuvres between a start and their goals at once, as arrays: closed, and timed."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ator_ros.geometry import BoolArray, FloatArray, Pose
from ator_ros.motion.displacements import TurnDriving, displacements
from ator_ros.motion.durations import drive_parts, turn_parts, turn_time
from ator_ros.motion.manoeuvre import STEPS, TOLERANCE, Side
from ator_ros.robot.description import Limits


@dataclass(frozen=True, slots=True)
class Bundle:
    """The fields of n manoeuvres; see `Manoeuvre`.

    Attributes
    ----------
    start : Pose
        Where all of them start.
    goals : ndarray, shape (3, n)
        x, y in m, yaw in rad.
    entries, exits : ndarray, shape (5, n)
        Length, outer speed, and the turn's speed, acceleration and greatest rate of each side.
    first, last, distance : ndarray, shape (n,)
        Turns in rad, straight drive in m.
    """

    start: Pose
    goals: FloatArray
    entries: FloatArray
    exits: FloatArray
    first: FloatArray
    last: FloatArray
    distance: FloatArray
    limits: Limits

    def __len__(self) -> int:
        return len(self.first)

    def picked(self, which: BoolArray) -> Bundle:
        """Return those manoeuvres that `which`, shape (n,), selects."""
        return Bundle(
            self.start, self.goals[:, which], self.entries[:, which], self.exits[:, which],
            self.first[which], self.last[which], self.distance[which], self.limits,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Course:
    """A velocity over time, for each of n manoeuvres: pieces in which it changes linearly.

    Attributes
    ----------
    durations, begins, ends : ndarray, shape (n, pieces)
        Time of each piece in s; the velocity at its two ends.
    """

    durations: FloatArray
    begins: FloatArray
    ends: FloatArray

    def at(self, times: FloatArray) -> FloatArray:
        """Return the velocities at `times` (s), shape (n, k)."""
        after = np.cumsum(self.durations, axis=1)
        shape = len(times), -1
        knots = np.stack((after - self.durations, after), axis=2).reshape(shape)
        values = np.stack((self.begins, self.ends), axis=2).reshape(shape)
        return np.stack([np.interp(*row) for row in zip(times, knots, values, strict=True)])


def side_table(sides: Sequence[Side]) -> FloatArray:
    """Return the numbers of sides as a bundle has them, shape (5, sides)."""
    return np.array([(side.length, side.outer_speed, *side.turn) for side in sides]).T


def closed_bundle(bundle: Bundle) -> tuple[Bundle, BoolArray]:
    """Solve for the first turns as `manoeuvre.closed` does; also tell for which that succeeded."""
    x0, x1 = bundle.first, bundle.first + 1e-4
    (f0, _), (f1, distance) = _gaps(bundle, x0), _gaps(bundle, x1)
    first, drive = x1.copy(), distance.copy()
    meets = np.abs(f1) < TOLERANCE
    active = np.flatnonzero(~meets & (f1 != f0))
    x0, x1, f0, f1 = x0[active], x1[active], f0[active], f1[active]
    for _ in range(STEPS - 1):
        if not len(active):
            break
        step = np.clip(-f1 * (x1 - x0) / (f1 - f0), -0.2, 0.2)
        x0, f0, x1 = x1, f1, x1 + step
        chosen = np.zeros(len(bundle), dtype=bool)
        chosen[active] = True
        f1, distance = _gaps(bundle.picked(chosen), x1)
        first[active], drive[active] = x1, distance
        meets[active] = np.abs(f1) < TOLERANCE
        going = ~meets[active] & (f1 != f0)
        active, x0, x1, f0, f1 = active[going], x0[going], x1[going], f0[going], f1[going]
    last = bundle.last - (first - bundle.first)
    return dataclasses.replace(bundle, first=first, last=last, distance=drive), meets


def _gaps(bundle: Bundle, first: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Compute how far each drive misses the last turn sideways, and its length, both in m."""
    start, (goal_x, goal_y, goal_yaw) = bundle.start, bundle.goals
    last = bundle.last - (first - bundle.first)
    one = displacements(first, TurnDriving(*bundle.entries[2:, :, None]), bundle.limits)
    two = displacements(-last, TurnDriving(*bundle.exits[2:, :, None]), bundle.limits)
    ahead, back = bundle.entries[0] + one[0], -bundle.exits[0] - two[0]
    c, s = np.cos(start.yaw), np.sin(start.yaw)
    begin_x, begin_y = start.x + c * ahead - s * one[1], start.y + s * ahead + c * one[1]
    c, s = np.cos(goal_yaw), np.sin(goal_yaw)
    dx = goal_x + c * back + s * two[1] - begin_x
    dy = goal_y + s * back - c * two[1] - begin_y
    c, s = np.cos(start.yaw + first), np.sin(start.yaw + first)
    return c * dy - s * dx, c * dx + s * dy


def courses(bundle: Bundle) -> tuple[Course, Course]:
    """Compute the translational and the rotational velocities over time; see `Manoeuvre.speed_pieces`."""
    limits = bundle.limits
    opening = _turn_speeds(bundle.first, bundle.entries, limits)
    closing = _turn_speeds(bundle.last, bundle.exits, limits)
    length, outer, inner = bundle.entries[:3]
    lead = _straight(length, outer, inner, limits)
    drive = _straight(bundle.distance, opening.ends[:, -1], closing.ends[:, -1], limits)
    length, outer, inner = bundle.exits[:3]
    run = _straight(length, inner, outer, limits)
    backward = Course(closing.durations[:, ::-1], closing.ends[:, ::-1], closing.begins[:, ::-1])
    turns = (
        _idle(lead), _turn(bundle.first, bundle.entries[4], limits), _idle(drive),
        _turn(bundle.last, bundle.exits[4], limits), _idle(run),
    )  # fmt: skip
    return _joined((lead, opening, drive, backward, run)), _joined(turns)


def _joined(parts: tuple[Course, ...]) -> Course:
    names = (field.name for field in dataclasses.fields(Course))
    return Course(*(np.concatenate([getattr(part, name) for part in parts], axis=1) for name in names))


def _straight(distance: FloatArray, v1: FloatArray, v2: FloatArray, limits: Limits) -> Course:
    gaining, steady, losing, top = drive_parts(distance, v1, v2, limits)
    pieces = np.stack((gaining, steady, losing), axis=1)
    return Course(pieces, np.stack((v1, top, top), axis=1), np.stack((top, top, v2), axis=1))


def _idle(straight: Course) -> Course:
    nothing = np.zeros((len(straight.durations), 1))
    return Course(straight.durations.sum(axis=1, keepdims=True), nothing, nothing)


def _turn(angles: FloatArray, rate: FloatArray, limits: Limits) -> Course:
    ramp, steady = turn_parts(angles, rate, limits.aw)
    signed, nothing = np.copysign(limits.aw * ramp, angles), np.zeros(len(angles))
    return Course(
        np.stack((ramp, steady, ramp), axis=1),
        np.stack((nothing, signed, signed), axis=1),
        np.stack((signed, signed, nothing), axis=1),
    )


def _turn_speeds(angles: FloatArray, sides: FloatArray, limits: Limits) -> Course:
    """Compute the speeds during turns, from their ends of the manoeuvres inward."""
    _, _, speed, acceleration, rate = sides
    total = turn_time(angles, rate, limits.aw)
    with np.errstate(invalid="ignore", divide="ignore"):
        bounded = np.maximum(0.0, (np.copysign(limits.v, acceleration) - speed) / acceleration)
    ramp = np.minimum(total, np.where(acceleration == 0.0, np.inf, bounded))
    reached = speed + acceleration * ramp
    return Course(
        np.stack((ramp, total - ramp), axis=1),
        np.stack((speed, reached), axis=1),
        np.stack((reached, reached), axis=1),
    )
