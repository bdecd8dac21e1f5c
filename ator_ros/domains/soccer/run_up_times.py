"""How long a run-up to a shot takes: straight, one turn, straight on until the ball is let go and rolls in.

A shot may go anywhere between the posts, in any direction. Whether a tight enough turn leads into the goal
decides between one second and six. A few ideal motions to fixed places cannot show that.
"""

from __future__ import annotations

from functools import lru_cache, partial

import numpy as np

from ator_ros.compiled import in_shares
from ator_ros.domains.soccer.ball import BALL
from ator_ros.domains.soccer.compiled_run_ups import ANGLES, HeldTurns, ShotSetting, fastest_run_ups
from ator_ros.domains.soccer.field import field_of
from ator_ros.domains.soccer.planned.holding import (
    LARGEST_TURN,
    MOST_GAINED,
    RUN_UP_RATES,
    gain_of,
    held_limits,
    keeps_ball,
)
from ator_ros.domains.soccer.planned.planned_action import planned_limits
from ator_ros.domains.soccer.planned.release import ROOM, SLANT, roll_of
from ator_ros.geometry import FloatArray
from ator_ros.motion.displacements import TurnDriving, displacement_table
from ator_ros.motion.durations import rates_of
from ator_ros.robot.description import Limits, Robot

_HEADINGS: FloatArray = np.linspace(-SLANT, SLANT, 25)
_SLANTS: FloatArray = np.column_stack((_HEADINGS, np.cos(_HEADINGS), np.sin(_HEADINGS), np.tan(_HEADINGS)))
_ENTRY_SHARES: FloatArray = np.array((0.0, 0.15, 0.35, 0.7))
_GAIN_SHARES = (*(step / 8 for step in range(8)), MOST_GAINED)
_SPEEDS = 51
_SHARE = 12
"""Situations that one core takes at least: some 60 microseconds."""


def run_up_times(robot: Robot, starts: FloatArray) -> FloatArray:
    """Return how long run-ups with one turn take until the ball is in the goal.

    Two turns, which the action also tries where the one is large, are not considered.

    Parameters
    ----------
    robot : Robot
        Holds the ball.
    starts : ndarray, shape (4, n)
        Pose of the axle in the frame of the goal's mouth (m, m, rad), x out of the field, and speed in m/s;
        the robot does not turn.

    Returns
    -------
    ndarray, shape (n,)
        In s; infinite where no run-up leads into the goal.

    Raises
    ------
    ValueError
        The starts have another shape.
    NoHolderError
        The robot holds nothing.
    """
    starts = np.ascontiguousarray(starts, dtype=float)
    if starts.ndim != 2 or len(starts) != 4:
        raise ValueError(f"starts: expected shape (4, n), got {starts.shape}")
    limits, turns, setting = _tables(robot)
    times = np.empty(starts.shape[1])
    speeds = _ENTRY_SHARES * limits.v
    search = partial(fastest_run_ups, starts, speeds, _SLANTS, turns, setting, rates_of(limits), times)
    in_shares(search, len(times), _SHARE)
    return times


@lru_cache(maxsize=8)
def _tables(robot: Robot) -> tuple[Limits, HeldTurns, ShotSetting]:
    """Return what plans may use of the limits with the ball, the turns that they allow, and the goal."""
    limits = planned_limits(robot, held_limits(robot, "a shot"))
    gains = np.array([share * gain_of(robot) for share in _GAIN_SHARES])
    speeds: FloatArray = np.linspace(0.0, limits.v, _SPEEDS)
    angles: FloatArray = np.linspace(0.0, LARGEST_TURN, ANGLES)
    rates = np.array([[_rate(robot, limits, v, change) for change in gains] for v in speeds])
    ways = [
        TurnDriving(float(v), float(change), float(rate))
        for v, row in zip(speeds, rates, strict=True)
        for change, rate in zip(gains, row, strict=True)
    ]
    table = displacement_table(angles, ways, limits).reshape(_SPEEDS, len(gains), 2, ANGLES)
    turns = HeldTurns(np.ascontiguousarray(table.transpose(0, 3, 1, 2)), rates, gains, float(speeds[1]))
    field, ball = field_of(robot), robot.scene.objects[BALL]
    setting = ShotSetting(
        robot.hold, robot.reach, ball.radius, ball.rolling_deceleration, robot.limits.brake,
        field.goal_width / 2.0, field.goal_depth, roll_of(robot), ROOM,
    )  # fmt: skip
    return limits, turns, setting


def _rate(robot: Robot, limits: Limits, v: float, change: float) -> float:
    """Return the greatest turn rate in rad/s that keeps the ball from `v` (m/s) on; the least if none."""
    rates = [share * limits.w for share in RUN_UP_RATES]
    kept = (rate for rate in rates if keeps_ball(robot, TurnDriving(v, change, rate), limits.v))
    return next(kept, rates[-1])
