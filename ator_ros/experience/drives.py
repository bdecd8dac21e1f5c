"""Drives in what a robot recorded of odometry and commands, their goals seen in hindsight.

One drive is what lies between two pauses of the commands, and its goal is where the robot came to rest. The
objects that it held at both ends tell which TOP of the domain it was, and which point the goal was meant for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial

import numpy as np

from ator_ros.actions.base import Goal, Point
from ator_ros.actions.situation import Situation
from ator_ros.experience.episode import Episode
from ator_ros.experience.streams import Streams, Track
from ator_ros.experience.vocabulary import Vocabulary, drive_between
from ator_ros.geometry import FloatArray, Pose
from ator_ros.robot.description import Robot
from ator_ros.tops.objects import is_held
from ator_ros.world.state import ObjectState, RobotState, Standstill, World

PAUSE = 0.3  # s without a command to move that separates two drives
SILENCE = 1.0  # s without any command, within which many a base stops by itself
SHORTEST = 0.5  # s that a drive lasts at least
_ROUNDING = 1e-6  # s; stamps since 1970 are rounded to 0.24 us
NOT_DRIVEN = Standstill(0.01, 0.02)
"""Greatest commands that count as a stop, and greatest recorded speeds that count as standing."""


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
    track = Track(streams)
    for begin, ceased in _spans(streams.cmd_vel.in_order(), partial(_stood, track)):
        end = _rest(track, ceased)
        if end - begin >= SHORTEST and track.begin <= begin and end <= track.end:
            episode = _episode(track, begin, end, robot, domain)
            if episode is not None:
                yield episode


def _spans(commands: FloatArray, stood: Callable[[float, float], bool]) -> Iterator[tuple[float, float]]:
    """Yield begin and end (s) of the times in which the robot was commanded to move.

    Where commands cease without one to stop, and the robot `stood` (between two times in s) before the next
    one, nobody knows where it wanted to go: that is no drive.
    """
    moving = ~NOT_DRIVEN.holds(commands[:, 1], commands[:, 2])
    begin: float | None = None
    end = last = 0.0
    for time, moves in zip(commands[:, 0].tolist(), moving.tolist(), strict=True):
        if begin is not None and end < begin and time - last > SILENCE and stood(last, time):
            begin = None
        last = time
        if begin is not None and not moves and end < begin:
            end = time
        if begin is not None and end >= begin and time - end >= PAUSE - _ROUNDING:
            yield begin, end
            begin = None
        if moves:
            begin = time if begin is None else begin
            end = begin - 1.0
    if begin is not None and end >= begin:
        yield begin, end


def _stood(track: Track, since: float, until: float) -> bool:
    """Return whether the robot stood at any time between two (s)."""
    times = track.odom[:, 0]
    during = track.odom[np.searchsorted(times, since, "right") : np.searchsorted(times, until)]
    return bool(NOT_DRIVEN.holds(during[:, 4], during[:, 5]).any())


def _rest(track: Track, ceased: float) -> float:
    """Return when (s) the robot stood still after its commands had ceased; `ceased` when it never did."""
    times = track.odom[:, 0]
    last = ceased + PAUSE + _ROUNDING
    after = track.odom[np.searchsorted(times, ceased) : np.searchsorted(times, last, "right")]
    still = NOT_DRIVEN.holds(after[:, 4], after[:, 5])
    return float(after[still][0, 0]) if still.any() else ceased


def _episode(track: Track, begin: float, end: float, robot: Robot, domain: Vocabulary) -> Episode | None:
    # The pause lets the robot come to rest: that is where it wanted to be.
    goal_pose = track.pose(min(end + PAUSE, track.end))
    start = track.world(begin)
    first = _held(robot, start.robot.pose, start.objects)
    last = _held(robot, goal_pose, track.objects(end))
    top = drive_between(domain, first, last)
    if top is None:
        return None
    held = top.point is Point.HOLD
    goal = Goal(robot.hold_point(goal_pose) if held else goal_pose, 0.0, top.point)
    return Episode(
        situation=Situation(top.action, start.robot, start.objects, goal),
        samples=track.samples(begin, end),
        duration=round(end - begin, 6),
        success=True,
        reason="recorded: its goal is where it came to rest",
        position_error=np.nan,
        heading_error=np.nan,
        objects=track.names,
    )


def _held(robot: Robot, pose: Pose, objects: Mapping[str, ObjectState]) -> str | None:
    """Return the first object that a robot at `pose` holds; None if there is none."""
    world = World(0.0, RobotState(pose), objects)
    return next((name for name in objects if is_held(world, robot, name)), None)
