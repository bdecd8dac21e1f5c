"""The motion of a plan over time: its opening, poses and velocities."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ator_ros.bases.differential.limits import Limits
from ator_ros.bases.differential.manoeuvre import Manoeuvre
from ator_ros.compiled import compiled
from ator_ros.geometry import FloatArray, Pose
from ator_ros.world.state import RobotState


@dataclass(frozen=True, slots=True)
class Opening:
    """The phase before a manoeuvre: the robot stops turning, at constant speed or to a stop."""

    start: RobotState
    end: RobotState  # does not turn
    duration: float  # s


def opening_of(start: RobotState, limits: Limits, *, stops: bool = False) -> Opening:
    """Return the shortest opening from `start`, with or without a stop."""
    after = 0.0 if stops else start.vx
    duration = max(abs(start.w) / limits.aw, abs(start.vx - after) / limits.brake)
    x, y, yaw = start.pose
    turned = start.w * duration
    # Simpson's rule over the headings at the start, in the middle and at the end: exact to 0.1 mm.
    for heading, speed in (
        (yaw, start.vx),
        (yaw + 0.375 * turned, 2.0 * (start.vx + after)),
        (yaw + 0.5 * turned, after),
    ):
        x += speed * duration / 6.0 * math.cos(heading)
        y += speed * duration / 6.0 * math.sin(heading)
    return Opening(start, RobotState(Pose(x, y, yaw + 0.5 * turned), after), duration)


DT = 0.01
"""Time in s between two samples of a trajectory."""


@compiled
def most_states(duration: float, interval: float) -> int:
    """Return an upper bound for the number of states `interval` s apart in `duration` s."""
    return int(duration / interval) + 3


@compiled
def write_states(
    states: FloatArray,
    speeds: FloatArray,
    turns: FloatArray,
    duration: float,
    start: Pose,
    goal: Pose,
    interval: float,
) -> int:
    """Write the states every `interval` s and at the end; return their number.

    A state is x, y (m), yaw (rad), v (m/s) and w (rad/s). `states` has the shape
    (most_states(duration, interval), 5); for `speeds` and `turns` see `write_pieces`. The
    error of integration at the goal is distributed over the motion.
    """
    piece = turn = index = 0
    piece_end = speeds[0, 0]
    turn_end = turns[0, 0]
    x, y, yaw = start
    v = speeds[0, 1]
    w = turns[0, 1]
    time = 0.0
    c = math.cos(yaw)
    s = math.sin(yaw)
    heading = yaw
    states[0] = x, y, yaw, v, w
    while time < duration:
        index += 1
        after = min(interval * index, duration)
        # A step ends where an acceleration changes, too: in between the velocities change linearly.
        while time < after:
            while time >= piece_end and piece < len(speeds) - 1:
                piece += 1
                piece_end += speeds[piece, 0]
                v = speeds[piece, 1]
            while time >= turn_end and turn < len(turns) - 1:
                turn += 1
                turn_end += turns[turn, 0]
                w = turns[turn, 1]
            until = after
            if time < piece_end < until:
                until = piece_end
            if time < turn_end < until:
                until = turn_end
            step = until - time
            time = until
            next_v = _value(speeds, piece, piece_end, time)
            next_w = _value(turns, turn, turn_end, time)
            turned = 0.5 * (w + next_w) * step
            middle = yaw + 0.5 * turned
            if middle != heading:
                c = math.cos(middle)
                s = math.sin(middle)
                heading = middle
            chord = 0.5 * (v + next_v) * step * (1.0 - turned * turned * (1.0 / 24.0))
            x += chord * c
            y += chord * s
            yaw += turned
            v = next_v
            w = next_w
        states[index] = x, y, yaw, v, w
    span = max(duration, interval)
    off_x = (goal.x - x) / span
    off_y = (goal.y - y) / span
    off = (goal.yaw - yaw + math.pi) % math.tau - math.pi
    off_yaw = off / span
    for at in range(index + 1):
        time = min(interval * at, duration)
        states[at, 0] += time * off_x
        states[at, 1] += time * off_y
        states[at, 2] += time * off_yaw
    return index + 1


@compiled
def _value(pieces: FloatArray, piece: int, end: float, time: float) -> float:
    """Return the velocity at `time` (s) in a piece that ends at `end` (s)."""
    duration = pieces[piece, 0]
    if duration <= 0.0 or time >= end:
        return float(pieces[piece, 2])
    return float(
        pieces[piece, 2] + (pieces[piece, 1] - pieces[piece, 2]) * ((end - time) / duration)
    )


class Trajectory:
    """An opening, a closed manoeuvre that starts at its end, or one of both, sampled every 10 ms.

    Attributes
    ----------
    duration : float
        Time from start to goal in s.
    """

    def __init__(self, manoeuvre: Manoeuvre | None, opening: Opening | None = None) -> None:
        pieces = list[tuple[FloatArray, FloatArray]]()
        poses = list[Pose]()
        if opening is not None:
            time = opening.duration
            first = opening.start
            last = opening.end
            pieces.append((np.array([[time, first.vx, last.vx]]), np.array([[time, first.w, 0.0]])))
            poses += [first.pose, last.pose]
        if manoeuvre is not None:
            pieces.append(manoeuvre.pieces()[:2])
            poses += [manoeuvre.start, manoeuvre.goal]
        speeds, turns = map(np.concatenate, zip(*pieces, strict=True))
        start = poses[0]
        goal = poses[-1]
        self.duration: float = sum(speeds[:, 0].tolist())
        states = np.empty((most_states(self.duration, DT), 5))
        count = write_states(states, speeds, turns, self.duration, start, goal, DT)
        self._columns = states[:count].T.copy()
        self._times = np.minimum(DT * np.arange(count), self.duration)

    def at(self, time: float) -> RobotState:
        """Return the planned state at `time` s after the start; after the end, the last one."""
        x, y, yaw, v, w = (float(np.interp(time, self._times, column)) for column in self._columns)
        return RobotState(Pose(x, y, yaw), v, w)

    def poses(self) -> FloatArray:
        """Return the sampled poses, shape (n, 3): x, y in m, yaw in rad."""
        return self._columns[:3].T
