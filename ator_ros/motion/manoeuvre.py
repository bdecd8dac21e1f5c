"""A manoeuvre: straight lead, turn, straight drive, turn, straight run, each as fast as the limits allow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ator_ros.geometry import FloatArray, Pose
from ator_ros.motion.displacements import TurnDriving, displacements
from ator_ros.motion.durations import Piece, direction, straight_pieces, turn_pieces, turn_time
from ator_ros.robot.description import Limits

TOLERANCE = 1e-7
"""Distance in m within which the drive of a closed manoeuvre meets the last turn."""
STEPS = 12
"""Steps of the secant method after which a manoeuvre counts as one that cannot be closed."""


@dataclass(frozen=True, slots=True)
class Side:
    """How one end of a manoeuvre is driven, seen from that end (at the goal: backward in time).

    Attributes
    ----------
    length : float
        Straight stretch at this end in m.
    outer_speed : float
        Speed at the very end in m/s.
    turn : TurnDriving
        How the turn next to the stretch is driven, from this end.
    """

    length: float
    outer_speed: float
    turn: TurnDriving


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """The five phases between two poses.

    Attributes
    ----------
    start, goal : Pose
        Both ends in the world frame.
    entry, exit : Side
        How the ends are driven.
    first, last : float
        Signed angles of the two turns in rad.
    distance : float
        Signed length of the straight drive between the turns in m (negative: backward).
    limits : Limits
        Speeds and accelerations of the plan.
    """

    start: Pose
    goal: Pose
    entry: Side
    exit: Side
    first: float
    last: float
    distance: float
    limits: Limits

    @property
    def duration(self) -> float:
        """Planned time in s."""
        return sum(piece.duration for piece in self.speed_pieces())

    def is_forward(self) -> bool:
        """Return whether the robot never drives backward, and the drive suffices for its change of speed."""
        suffices = direction(self.distance, *self._drive_speeds(), self.limits) > 0.0
        return bool(suffices) and all(p.end >= -1e-6 for p in self.speed_pieces() if p.duration > 0.0)

    def _drive_speeds(self) -> tuple[float, float]:
        """Return the speeds at both ends of the straight drive in m/s."""
        opening = _turn_speeds(self.first, self.entry.turn, self.limits)
        closing = _turn_speeds(self.last, self.exit.turn, self.limits)
        return opening[-1].end, closing[-1].end

    def speed_pieces(self) -> list[Piece]:
        """Return the translational velocity over time."""
        opening = _turn_speeds(self.first, self.entry.turn, self.limits)
        closing = [
            Piece(p.duration, p.end, p.start) for p in _turn_speeds(self.last, self.exit.turn, self.limits)
        ]
        closing.reverse()
        v1 = opening[-1].end
        v2 = closing[0].start
        return [
            *straight_pieces(self.entry.length, self.entry.outer_speed, self.entry.turn.speed, self.limits),
            *opening,
            *straight_pieces(self.distance, v1, v2, self.limits),
            *closing,
            *straight_pieces(self.exit.length, self.exit.turn.speed, self.exit.outer_speed, self.limits),
        ]

    def turn_pieces(self) -> list[Piece]:
        """Return the rotational velocity over time."""
        aw = self.limits.aw

        def idle(distance: float, v1: float, v2: float) -> Piece:
            return Piece(sum(p.duration for p in straight_pieces(distance, v1, v2, self.limits)), 0.0, 0.0)

        return [
            idle(self.entry.length, self.entry.outer_speed, self.entry.turn.speed),
            *turn_pieces(self.first, self.entry.turn.turn_rate, aw),
            idle(self.distance, *self._drive_speeds()),
            *turn_pieces(self.last, self.exit.turn.turn_rate, aw),
            idle(self.exit.length, self.exit.turn.speed, self.exit.outer_speed),
        ]


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


def side_table(sides: Sequence[Side]) -> FloatArray:
    """Return the numbers of sides as a bundle has them, shape (5, sides)."""
    return np.array([(side.length, side.outer_speed, *side.turn) for side in sides]).T


def closed(manoeuvre: Manoeuvre) -> Manoeuvre | None:
    """Solve for the first turn that makes the manoeuvre meet its goal, near the one it has.

    Returns None where the secant method does not converge.
    """

    def gap(first: float) -> tuple[float, float]:
        return _lateral_gap(manoeuvre, first)

    x0, x1 = manoeuvre.first, manoeuvre.first + 1e-4
    (f0, _), (f1, distance) = gap(x0), gap(x1)
    for _ in range(STEPS):
        if abs(f1) < TOLERANCE:
            last = manoeuvre.last - (x1 - manoeuvre.first)
            return Manoeuvre(
                manoeuvre.start, manoeuvre.goal, manoeuvre.entry, manoeuvre.exit,
                x1, last, distance, manoeuvre.limits,
            )  # fmt: skip
        if f1 == f0:
            return None
        step = float(np.clip(-f1 * (x1 - x0) / (f1 - f0), -0.2, 0.2))
        x0, f0 = x1, f1
        x1 += step
        f1, distance = gap(x1)
    return None


def _lateral_gap(manoeuvre: Manoeuvre, first: float) -> tuple[float, float]:
    """Return how far the straight drive misses the last turn sideways, and its length, both in m."""
    start, goal, limits = manoeuvre.start, manoeuvre.goal, manoeuvre.limits
    entry, exit_ = manoeuvre.entry, manoeuvre.exit
    last = manoeuvre.last - (first - manoeuvre.first)
    one = displacements(np.array([first]), entry.turn, limits)[:, 0]
    two = displacements(np.array([-last]), exit_.turn, limits)[:, 0]
    begin = start.compose(Pose(entry.length + float(one[0]), float(one[1]), first))
    end = goal.compose(Pose(-exit_.length - float(two[0]), -float(two[1]), 0.0))
    dx, dy = end.x - begin.x, end.y - begin.y
    c, s = math.cos(start.yaw + first), math.sin(start.yaw + first)
    return c * dy - s * dx, c * dx + s * dy


def _turn_speeds(angle: float, turn: TurnDriving, limits: Limits) -> list[Piece]:
    """Return the speed during a turn, from its end of the manoeuvre inward."""
    total = float(turn_time(angle, turn.turn_rate, limits.aw))
    if turn.acceleration == 0.0:
        return [Piece(total, turn.speed, turn.speed)]
    bound = math.copysign(limits.v, turn.acceleration)
    ramp = min(total, max(0.0, (bound - turn.speed) / turn.acceleration))
    reached = turn.speed + turn.acceleration * ramp
    pieces = [Piece(ramp, turn.speed, reached)]
    if ramp < total:
        pieces.append(Piece(total - ramp, reached, reached))
    return pieces
