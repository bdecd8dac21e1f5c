"""Which Bezier curve: of a fan of curves to the goal, the one that takes least time."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np

from ator_ros.actions.bezier.curve import (
    Paths,
    as_row,
    bezier_paths,
    drive_time,
    left_of,
    length_outside,
    length_touching,
    sharpness,
)
from ator_ros.geometry import FloatArray, Pose, wrap_angles
from ator_ros.robot import Limits, Robot
from ator_ros.world import BallState, RobotState

RUN_IN = 0.4
"""Length in m of the straight line that leads to a ball, or to where one is put."""
BACK_UP = 0.4
"""How far the robot backs up, in m."""
BACK_SPEED = 0.4
"""How fast it backs up, in m/s."""

# A handle of a third of the distance makes the lateral error vanish with its square.
_SHARE = 1.0 / 3.0
_BUMPS = (0.0, 0.8, -0.8, 1.8, -1.8)
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


def run_in_length(rel: Pose) -> float:
    """Give the length in m of the straight line to aim for, from the robot's pose in the goal's frame.

    It shrinks as a robot that is about in line comes near, so that the curve before it never gets tight.
    """
    if abs(rel.y) < 0.15 and abs(rel.yaw) < 0.6 and rel.x < 0.0:
        return min(RUN_IN, max(-rel.x - 0.5, 0.0))
    return RUN_IN


class Maneuver(enum.Enum):
    """What comes before the curve: nothing, a turn on the spot, or backing up straight."""

    FOLLOW = "follow"
    TURN = "turn"
    BACK_UP = "back up"


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


@dataclass(frozen=True, slots=True)
class _Fan:
    """Curves after the same maneuver: starts (n, 3), handles (n, 2), bumps (n,), time before them (n,) in s."""

    maneuver: Maneuver
    starts: FloatArray
    handles: FloatArray
    bumps: FloatArray
    before: FloatArray


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
    back = pose.ahead(-BACK_UP)
    backing = stopping + BACK_UP / BACK_SPEED + (5.0 if _behind(pose, ball, robot) else 0.0)
    turning = stopping + (5.0 if _beside(pose, ball, robot) else 0.0)
    fans = [
        _fan(Maneuver.FOLLOW, pose, target, run_in, _FREE_HANDLES, _FREE_HANDLES),
        _turned(Maneuver.TURN, pose, target, run_in, turning, limits),
        _turned(Maneuver.BACK_UP, back, target, run_in, backing, limits),
    ]
    return _best(fans, target, robot, limits, run_in=run_in, ball=ball, previous=previous, radius=None)


def choose_dribble(
    state: RobotState, targets: list[Pose], robot: Robot, *, run_in: float, previous: int | None
) -> tuple[Choice, Pose]:
    """Choose a curve to any of the targets for a robot with the ball in front: wide, and forward only."""
    limits, count = robot.dribble_limits, len(targets)
    fans = [
        _fan(Maneuver.FOLLOW, state.pose, target, run_in, _DRIBBLE_HANDLES, _DRIBBLE_HANDLES)
        for target in targets
    ]
    size = len(fans[0].bumps)
    ends = np.repeat(np.stack([as_row(target) for target in targets]), size, axis=0)
    choice = _best(
        fans, ends, robot, limits, run_in=run_in, ball=None, previous=previous, radius=_DRIBBLE_RADIUS
    )
    return choice, targets[min(choice.index // size, count - 1)]


def _best(
    fans: list[_Fan],
    target: Pose | FloatArray,
    robot: Robot,
    limits: Limits,
    *,
    run_in: float,
    ball: BallState | None,
    previous: int | None,
    radius: float | None,
) -> Choice:
    starts = np.concatenate([fan.starts for fan in fans])
    ends = np.tile(as_row(target), (len(starts), 1)) if isinstance(target, Pose) else target
    handles = np.concatenate([fan.handles for fan in fans])
    bumps = np.concatenate([fan.bumps for fan in fans])
    paths = bezier_paths(starts, ends, handles, bumps, run_in)
    times = np.concatenate([fan.before for fan in fans]) + drive_time(paths, v=limits.v, w=limits.w)
    times += _OUTSIDE * length_outside(paths, robot)
    if radius is not None:
        times += _TOO_SHARP * sharpness(paths, radius=radius)
    if ball is not None:
        times += _TOUCHING * length_touching(
            paths, robot, (ball.x, ball.y), clearance=_CLEARANCE, slack=_TAKEN_IN
        )
    if previous is not None and previous < len(times):
        times[previous] *= _FAITHFUL
    index = int(np.argmin(times))
    maneuvers = [fan.maneuver for fan in fans for _ in fan.bumps]
    return Choice(maneuvers[index], paths.row(index), float(starts[index, 2]), float(times[index]), index)


def _fan(
    maneuver: Maneuver,
    pose: Pose,
    target: Pose,
    run_in: float,
    outs: tuple[float, ...],
    ins: tuple[float, ...],
) -> _Fan:
    """Give every combination of first handle, last handle and bump from `pose`."""
    share = _SHARE * pose.distance(target.ahead(-run_in))
    grid = np.array([(o, i, b) for o in (share, *outs) for i in (share, *ins) for b in _BUMPS])
    return _Fan(maneuver, np.tile(as_row(pose), (len(grid), 1)), grid[:, :2], grid[:, 2], np.zeros(len(grid)))


def _turned(
    maneuver: Maneuver, pose: Pose, target: Pose, run_in: float, before: float, limits: Limits
) -> _Fan:
    """Give the fan from `pose` after a turn on the spot into each curve; `before` in s is added."""
    fan = _fan(maneuver, pose, target, run_in, (), _FREE_HANDLES)
    first, end = as_row(pose)[:2], as_row(target.ahead(-run_in))
    into = np.array([np.cos(end[2]), np.sin(end[2])])
    third = end[:2] - fan.handles[:, 1:] * into
    aim = np.where(fan.bumps[:, None] == 0.0, third, (first + third) / 2)
    aim = aim + 0.5 * fan.bumps[:, None] * left_of((end[:2] - first)[None, :], into[None, :])
    headings = np.arctan2(aim[:, 1] - first[1], aim[:, 0] - first[0])
    if pose.distance(target) < 2 * _CLEARANCE:
        headings[fan.bumps == 0.0] = target.yaw
    turn = np.abs(wrap_angles(headings - pose.yaw))
    starts = np.concatenate([fan.starts[:, :2], headings[:, None]], axis=1)
    return _Fan(maneuver, starts, fan.handles, fan.bumps, before + turn / limits.w)


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
