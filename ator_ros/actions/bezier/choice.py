"""Which Bezier curve: of fans of curves to the goal, the one that takes least time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ator_ros.actions.bezier.curve import Paths, drive_time, length_outside, length_touching, sharpness
from ator_ros.actions.bezier.fan import Fan, Maneuver, fan, turned_fan
from ator_ros.geometry import FloatArray, Pose
from ator_ros.robot import Limits, Robot
from ator_ros.world import BallState, RobotState

BACK_UP = 0.4
"""How far the robot backs up, in m."""
BACK_SPEED = 0.4
"""How fast it backs up, in m/s."""

_FREE_HANDLES = (0.3, 0.8)
_DRIBBLE_HANDLES = (0.5, 1.0, 1.6)
_DRIBBLE_RADIUS = 0.4
_STOP_AND_GO = 0.5
_TOUCHING = 10.0
_OUTSIDE = 10.0
_TOO_SHARP = 5.0
_CLEARANCE = 0.05
_TAKEN_IN = 0.03
_FAITHFUL = 0.95


@dataclass(frozen=True, slots=True)
class Choice:
    """The chosen curve.

    Attributes
    ----------
    maneuver : Maneuver
        What comes first.
    path : Paths
        One path, from where the maneuver ends to the goal.
    heading : float
        The path's direction at its start in rad.
    time : float
        Estimated time in s to the goal, with penalties for a path that cannot be followed.
    index : int
        Which curve of the fan it is.
    """

    maneuver: Maneuver
    path: Paths
    heading: float
    time: float
    index: int


def choose_free(
    state: RobotState,
    target: Pose,
    robot: Robot,
    *,
    run_in: float,
    ball: BallState | None,
    previous: int | None,
) -> Choice:
    """Choose a curve for a robot without a ball, which may also turn on the spot or back up first.

    Parameters
    ----------
    state : RobotState
        Where the robot is.
    target : Pose
        Where its axle shall come to.
    robot : Robot
        Shape and limits.
    run_in : float
        Length in m of the straight line before the target.
    ball : BallState, optional
        A ball not to be pushed before the target.
    previous : int, optional
        `Choice.index` of the tick before; it is kept unless another is clearly better.
    """
    limits, pose = robot.limits, state.pose
    stopping = abs(state.v) / limits.a + _STOP_AND_GO
    backing = stopping + BACK_UP / BACK_SPEED + (5.0 if _behind(pose, ball, robot) else 0.0)
    turning = stopping + (5.0 if _beside(pose, ball, robot) else 0.0)
    fans = [fan(pose, target, run_in=run_in, outs=_FREE_HANDLES, ins=_FREE_HANDLES, corners=True)]
    for maneuver, start, before in (
        (Maneuver.TURN, pose, turning),
        (Maneuver.BACK_UP, pose.ahead(-BACK_UP), backing),
    ):
        fans.append(
            turned_fan(
                maneuver, start, target, run_in=run_in, ins=_FREE_HANDLES, before=before, turn_speed=limits.w
            )
        )
    times = [_times(each, robot, limits, with_ball=False) for each in fans]
    if ball is not None:
        for each, time in zip(fans, times, strict=True):
            time += _TOUCHING * length_touching(
                each.paths, robot, (ball.x, ball.y), clearance=_CLEARANCE, slack=_TAKEN_IN
            )
    return _best(fans, times, previous)


def choose_dribble(
    state: RobotState, targets: list[Pose], robot: Robot, *, run_in: float, previous: int | None
) -> tuple[Choice, Pose]:
    """Choose a curve to any of the targets for a robot with the ball in front: wide, and forward only."""
    handles = _DRIBBLE_HANDLES
    fans = [
        fan(state.pose, target, run_in=run_in, outs=handles, ins=handles, corners=run_in > 0.0)
        for target in targets
    ]
    times = [
        _times(each, robot, robot.dribble_limits, with_ball=True)
        + _TOO_SHARP * sharpness(each.paths, radius=_DRIBBLE_RADIUS)
        for each in fans
    ]
    choice = _best(fans, times, previous)
    return choice, targets[choice.index // len(times[0])]


def _times(curves: Fan, robot: Robot, limits: Limits, *, with_ball: bool) -> FloatArray:
    """Give the time in s for each curve of a fan, shape (n,), with the penalty for leaving the field."""
    outside = length_outside(curves.paths, robot, with_ball=with_ball)
    return curves.before + drive_time(curves.paths, v=limits.v, w=limits.w) + _OUTSIDE * outside


def _best(fans: list[Fan], times: list[FloatArray], previous: int | None) -> Choice:
    """Choose the least time, with some faith in the choice of the tick before."""
    together = np.concatenate(times)
    if previous is not None and previous < len(together):
        together[previous] *= _FAITHFUL
    index = row = int(np.argmin(together))
    for curves, time in zip(fans, times, strict=True):  # noqa: B007 - used after the loop
        if row < len(time):
            break
        row -= len(time)
    return Choice(
        curves.maneuver, curves.paths.row(row), float(curves.starts[row, 2]), float(together[index]), index
    )


def _beside(pose: Pose, ball: BallState | None, robot: Robot) -> bool:
    """Say whether a turn on the spot would hit the ball."""
    if ball is None:
        return False
    return pose.distance(Pose(ball.x, ball.y, 0.0)) < robot.reach + robot.ball.radius + 0.02


def _behind(pose: Pose, ball: BallState | None, robot: Robot) -> bool:
    """Say whether backing up would hit the ball."""
    if ball is None:
        return False
    local = pose.relative(Pose(ball.x, ball.y, 0.0))
    room = robot.ball.radius + _CLEARANCE
    return -robot.rear - BACK_UP - room < local.x < 0.0 and abs(local.y) < robot.half_width + room
