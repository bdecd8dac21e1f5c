"""Drives in what a robot recorded of odometry and commands, their goals seen in hindsight.

One drive is what lies between two pauses of the commands, and its goal is where the robot came to rest. A
drive that ends with the ball held had the ball for its goal; held at both ends it was a dribble.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from ator_ros.actions.base import Goal, Point
from ator_ros.actions.situation import Situation
from ator_ros.experience.episode import Episode
from ator_ros.geometry import FloatArray, Pose, wrap_angle
from ator_ros.robot.ball import BALL, objects_of
from ator_ros.robot.description import Robot
from ator_ros.tops.objects import is_held
from ator_ros.world.state import ObjectState, RobotState, World

PAUSE = 0.3  # s without a command to move that separates two drives
SHORTEST = 0.5  # s that a drive lasts at least
STILL = (0.01, 0.02)  # m/s and rad/s up to which a command is one to stop
SILENCE = 1.0  # s without odometry after which another stretch of time begins
PERIOD = 0.1  # s between examples, the paper's 10 Hz


@dataclass
class Streams:
    """A stretch of a robot's time: odom (t, x, y, yaw, v, w), commands (t, v, w) and ball (t, x, y)."""

    odom: list[tuple[float, ...]] = field(default_factory=list)
    cmd_vel: list[tuple[float, ...]] = field(default_factory=list)
    ball: list[tuple[float, ...]] = field(default_factory=list)

    def goes_on_at(self, time: float) -> bool:
        """Return whether odometry of `time` (s) follows: not after a reset, nor after a long silence."""
        return not self.odom or 0.0 <= time - self.odom[-1][0] <= SILENCE


def drives(streams: Streams, robot: Robot) -> Iterator[Episode]:
    """Yield the drives of one stretch of time as episodes that succeeded."""
    if not streams.odom or not streams.cmd_vel:
        return
    odom = _in_order(streams.odom)
    odom[:, 3] = np.unwrap(odom[:, 3])
    ball = _in_order(streams.ball) if streams.ball else None
    for begin, ceased in _spans(_in_order(streams.cmd_vel)):
        end = _rest(odom, ceased)
        if end - begin >= SHORTEST and odom[0, 0] <= begin and end <= odom[-1, 0]:
            yield _episode(odom, ball, begin, end, robot)


def _in_order(rows: list[tuple[float, ...]]) -> FloatArray:
    table = np.array(rows, dtype=float)
    return table[np.argsort(table[:, 0], kind="stable")]


def _spans(commands: FloatArray) -> Iterator[tuple[float, float]]:
    """Yield begin and end (s) of the times in which the robot was told to move."""
    moving = (np.abs(commands[:, 1]) > STILL[0]) | (np.abs(commands[:, 2]) > STILL[1])
    begin: float | None = None
    end = 0.0
    for time, moves in zip(commands[:, 0].tolist(), moving.tolist(), strict=True):
        if begin is not None and not moves and end < begin:
            end = time
        if begin is not None and end >= begin and time - end >= PAUSE:
            yield begin, end
            begin = None
        if moves:
            begin = time if begin is None else begin
            end = begin - 1.0
    if begin is not None and end >= begin:
        yield begin, end


def _rest(odom: FloatArray, ceased: float) -> float:
    """Return when (s) the robot stood still after its commands had ceased; `ceased` when it never did."""
    after = odom[(odom[:, 0] >= ceased) & (odom[:, 0] <= ceased + PAUSE)]
    still = (np.abs(after[:, 4]) <= STILL[0]) & (np.abs(after[:, 5]) <= STILL[1])
    return float(after[still][0, 0]) if still.any() else ceased


def _episode(odom: FloatArray, ball: FloatArray | None, begin: float, end: float, robot: Robot) -> Episode:
    # The pause lets the robot come to rest: that is where it wanted to be.
    goal_row = _at(odom, min(end + PAUSE, float(odom[-1, 0])))
    goal_pose = _pose(goal_row)
    start = _at(odom, begin)
    first, last = (_ball_at(ball, time) for time in (begin, end))
    held_first, held_last = _held(robot, _pose(start), first), _held(robot, goal_pose, last)
    if held_last:
        goal = Goal(robot.hold_point(goal_pose), 0.0, Point.HOLD)
    else:
        goal = Goal(goal_pose, 0.0, Point.AXLE)
    action = "dribbleBall" if held_first and held_last else "goToPose"
    state = RobotState(_pose(start), float(start[4]), float(start[5]))
    rows = []
    for number in range(int((end - begin) / PERIOD - 1e-9) + 1):
        row = _at(odom, begin + number * PERIOD)
        there = _ball_at(ball, begin + number * PERIOD)
        place = (there.x, there.y) if there is not None else (np.nan, np.nan)
        rows.append((number * PERIOD, row[1], row[2], wrap_angle(float(row[3])), row[4], row[5], *place))
    return Episode(
        situation=Situation(action, state, objects_of(first), goal),
        samples=np.array(rows, dtype=float),
        duration=end - begin,
        success=True,
        reason="recorded: its goal is where it came to rest",
        position_error=np.nan,
        heading_error=np.nan,
    )


def _at(table: FloatArray, time: float) -> FloatArray:
    return np.array([np.interp(time, table[:, 0], column) for column in table.T])


def _pose(row: FloatArray) -> Pose:
    return Pose(float(row[1]), float(row[2]), wrap_angle(float(row[3])))


def _ball_at(ball: FloatArray | None, time: float) -> ObjectState | None:
    if ball is None or time < ball[0, 0]:
        return None
    row = _at(ball, time)
    return ObjectState(float(row[1]), float(row[2]))


def _held(robot: Robot, pose: Pose, ball: ObjectState | None) -> bool:
    return is_held(World(0.0, RobotState(pose), objects_of(ball)), robot, BALL)
