"""Drives in what a robot recorded of odometry and commands, their goals seen in hindsight.

One drive is what lies between two pauses of the commands, and its goal is where the robot came to rest. The
objects that it held at both ends tell which TOP of the domain it was, and which point the goal was meant for.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from ator_ros.actions.base import Goal, Point
from ator_ros.actions.situation import Situation
from ator_ros.experience.episode import Episode, sample_of
from ator_ros.experience.vocabulary import Vocabulary, drive_between
from ator_ros.geometry import FloatArray, Pose, wrap_angle
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
    """A stretch of a robot's time: odom (t, x, y, yaw, v, w), commands (t, v, w), objects (t, x, y)."""

    odom: list[tuple[float, ...]] = field(default_factory=list)
    cmd_vel: list[tuple[float, ...]] = field(default_factory=list)
    objects: dict[str, list[tuple[float, ...]]] = field(default_factory=lambda: defaultdict(list))

    def goes_on_at(self, time: float) -> bool:
        """Return whether odometry of `time` (s) follows: not after a reset, nor after a long silence."""
        return not self.odom or 0.0 <= time - self.odom[-1][0] <= SILENCE


def drives(streams: Streams, robot: Robot, domain: Vocabulary) -> Iterator[Episode]:
    """Yield the drives of one stretch of time as episodes that succeeded.

    Parameters
    ----------
    streams : Streams
        What was recorded.
    robot : Robot
        The robot that was recorded.
    domain : Vocabulary
        Its TOPs say which actions the drives were; without one that drives there is none.
    """
    if not streams.odom or not streams.cmd_vel:
        return
    odom = _in_order(streams.odom)
    odom[:, 3] = np.unwrap(odom[:, 3])
    objects = {name: _in_order(rows) for name, rows in streams.objects.items() if rows}
    for begin, ceased in _spans(_in_order(streams.cmd_vel)):
        end = _rest(odom, ceased)
        if end - begin >= SHORTEST and odom[0, 0] <= begin and end <= odom[-1, 0]:
            episode = _episode(odom, objects, begin, end, robot, domain)
            if episode is not None:
                yield episode


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


def _episode(
    odom: FloatArray,
    objects: Mapping[str, FloatArray],
    begin: float,
    end: float,
    robot: Robot,
    domain: Vocabulary,
) -> Episode | None:
    # The pause lets the robot come to rest: that is where it wanted to be.
    goal_pose = _pose(_at(odom, min(end + PAUSE, float(odom[-1, 0]))))
    start = _world_at(odom, objects, begin)
    first = _held(robot, start.robot.pose, start.objects)
    last = _held(robot, goal_pose, _objects_at(objects, end))
    top = drive_between(domain, first, last)
    if top is None:
        return None
    held = top.point is Point.HOLD
    goal = Goal(robot.hold_point(goal_pose) if held else goal_pose, 0.0, top.point)
    names = tuple(objects)
    times = [begin + number * PERIOD for number in range(int((end - begin) / PERIOD - 1e-9) + 1)]
    rows = [
        (number * PERIOD, *sample_of(_world_at(odom, objects, time), begin, names)[1:])
        for number, time in enumerate(times)
    ]
    return Episode(
        situation=Situation(top.action, start.robot, start.objects, goal),
        samples=np.array(rows, dtype=float),
        duration=end - begin,
        success=True,
        reason="recorded: its goal is where it came to rest",
        position_error=np.nan,
        heading_error=np.nan,
        objects=names,
    )


def _world_at(odom: FloatArray, objects: Mapping[str, FloatArray], time: float) -> World:
    row = _at(odom, time)
    return World(time, RobotState(_pose(row), float(row[4]), float(row[5])), _objects_at(objects, time))


def _at(table: FloatArray, time: float) -> FloatArray:
    return np.array([np.interp(time, table[:, 0], column) for column in table.T])


def _pose(row: FloatArray) -> Pose:
    return Pose(float(row[1]), float(row[2]), wrap_angle(float(row[3])))


def _objects_at(objects: Mapping[str, FloatArray], time: float) -> dict[str, ObjectState]:
    """Return the objects that had been seen by `time` (s)."""
    seen = {name: _at(table, time) for name, table in objects.items() if time >= table[0, 0]}
    return {name: ObjectState(float(row[1]), float(row[2])) for name, row in seen.items()}


def _held(robot: Robot, pose: Pose, objects: Mapping[str, ObjectState]) -> str | None:
    """Return the first object that a robot at `pose` holds; None if there is none."""
    world = World(0.0, RobotState(pose), objects)
    return next((name for name in objects if is_held(world, robot, name)), None)
