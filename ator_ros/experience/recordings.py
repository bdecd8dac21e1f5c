"""Experience from recordings (MCAP, made by ``ros2 bag record -s mcap``): a real robot has no other.

The records that our executor publishes on ``performance/action`` are taken as they are. From ``odom`` and
``cmd_vel`` (and ``ball`` where there is one), one drive is what lies between two pauses of the commands. Its
goal is seen in hindsight: where the robot came to rest. A drive that ends with the ball held had the ball for
its goal; with the ball held at both ends it was a dribble.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ator_ros.actions.base import Goal, Point
from ator_ros.experience.episode import HELD, SAMPLE_COLUMNS, Episode
from ator_ros.experience.situations import Situation
from ator_ros.experience.table import Experience, ExperienceError, episode_frame, join, library_versions
from ator_ros.geometry import FloatArray, Pose, wrap_angle, yaw_from_quaternion
from ator_ros.robot import Robot
from ator_ros.world import BallState, RobotState

PAUSE = 0.3  # s without a command to move that separates two drives
SHORTEST = 0.5  # s that a drive lasts at least
STILL = (0.01, 0.02)  # m/s and rad/s up to which a command is one to stop
SILENCE = 1.0  # s without odometry after which another stretch of time begins
PERIOD = 0.1  # s between examples, the paper's 10 Hz
TOPICS = ("odom", "cmd_vel", "ball")
RECORDS = "performance/action"
SUCCEEDED, FAILED = 1, 2  # codes of ator_interfaces/msg/Outcome


class RecordingError(ExperienceError):
    """A recording that holds no experience; the message names it and says what was expected."""


@dataclass
class _Streams:
    """A stretch of a robot's time: odom (t, x, y, yaw, v, w), commands (t, v, w) and ball (t, x, y)."""

    odom: list[tuple[float, ...]] = field(default_factory=list)
    cmd_vel: list[tuple[float, ...]] = field(default_factory=list)
    ball: list[tuple[float, ...]] = field(default_factory=list)

    def goes_on_at(self, time: float) -> bool:
        """Say whether odometry of `time` (s) follows: not after a reset, nor after a long silence."""
        return not self.odom or 0.0 <= time - self.odom[-1][0] <= SILENCE


@dataclass
class _Recorded:
    """What one robot recorded: stretches of its time, and the executor's records."""

    stretches: list[_Streams] = field(default_factory=lambda: [_Streams()])
    records: list[Episode] = field(default_factory=list)

    def episodes(self, robot: Robot) -> Iterator[Episode]:
        """Yield the executor's records, or the drives where there are none."""
        if self.records:
            yield from self.records
        else:
            for streams in self.stretches:
                yield from _drives(streams, robot)


def read_recording(path: Path | str, robot: Robot) -> Experience:
    """Read the drives of a recording as experience.

    Parameters
    ----------
    path : Path or str
        An .mcap file, or the folder that ``ros2 bag record`` made.
    robot : Robot
        The robot that was recorded.

    Raises
    ------
    RecordingError
        rosbags is not installed, or the recording is damaged, lacks a topic, or holds no drive.
    """
    file = Path(path)
    by_robot = _read(file)
    episodes = [episode for recorded in by_robot.values() for episode in recorded.episodes(robot)]
    if not episodes:
        raise RecordingError(
            f"{file}: expected the topic {RECORDS}, or odom and cmd_vel with at least one drive of "
            f"{SHORTEST} s between two stops; found {', '.join(by_robot) or 'no such topics'} without one"
        )
    numbers: dict[str, int] = defaultdict(int)
    frames: list[pd.DataFrame] = []
    for episode in episodes:
        action = episode.situation.action
        frames.append(episode_frame(numbers[action], episode))
        numbers[action] += 1
    metadata = {
        "seed": None,
        "robot_digest": robot.digest(),
        "action_set": "default",
        "command": f"recording {file.name}",
        "versions": library_versions(),
    }
    return Experience(join(frames), metadata)


def _read(file: Path) -> dict[str, _Recorded]:
    """Give what was recorded by the namespace of the robot."""
    by_robot: dict[str, _Recorded] = defaultdict(_Recorded)
    for name, message in _messages(file):
        topic = _kind(name)
        namespace = name[: -len(topic)] or "/"
        if topic != RECORDS:
            _add(by_robot[namespace], topic, message)
        elif message.outcome.code in (SUCCEEDED, FAILED) and _finite(_numbers(episode := _record(message))):
            by_robot[namespace].records.append(episode)
    return by_robot


def _messages(file: Path) -> Iterator[tuple[str, Any]]:
    """Yield topic and message of all that is of use, in the order of their arrival."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise RecordingError("recordings need the package rosbags: pip install rosbags") from error
    try:
        with AnyReader([file], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
            wanted = [c for c in reader.connections if _kind(c.topic)]
            for connection, _, raw in reader.messages(connections=wanted):
                yield connection.topic, reader.deserialize(raw, connection.msgtype)
    except Exception as error:  # a damaged file makes rosbags raise anything, MemoryError included
        raise RecordingError(f"{file}: expected a recording of ros2 bag record -s mcap: {error}") from error


def _kind(topic: str) -> str:
    """Give which of the topics `topic` is, in whatever namespace; empty for none."""
    return next((name for name in (RECORDS, *TOPICS) if f"/{topic}".endswith(f"/{name}")), "")


def _record(message: Any) -> Episode:
    """Give the episode that an ActionPerformance tells of."""
    start, call = message.start, message.call
    ball = (
        BallState(start.ball.x, start.ball.y, start.ball_velocity.x, start.ball_velocity.y)
        if start.ball_known
        else None
    )
    point = Point.AXLE if call.top == "goToPose" else Point.HOLD
    return Episode(
        situation=Situation(
            message.action,
            RobotState(_pose_of(start.robot), start.v, start.w),
            ball,
            Goal(_pose_of(call.goal.pose), call.speed, point),
        ),
        samples=np.empty((0, len(SAMPLE_COLUMNS))),
        duration=message.actual.duration,
        success=message.outcome.code == SUCCEEDED,
        reason=message.outcome.reason,
        position_error=message.actual.accuracy,
        heading_error=message.heading_error,
    )


def _numbers(episode: Episode) -> tuple[float, ...]:
    """Give what a model learns from."""
    robot, goal = episode.situation.robot, episode.situation.goal
    return (episode.duration, *robot.pose, robot.v, robot.w, *goal.pose, goal.speed)


def _finite(row: tuple[float, ...]) -> bool:
    """Say whether a row can be used: a sensor may have sent NaN."""
    return all(map(math.isfinite, row))


def _pose_of(pose: Any) -> Pose:
    q = pose.orientation
    return Pose(pose.position.x, pose.position.y, yaw_from_quaternion(q.x, q.y, q.z, q.w))


def _add(recorded: _Recorded, topic: str, message: Any) -> None:
    streams = recorded.stretches[-1]
    if topic == "cmd_vel":
        # A Twist has no stamp: it counts from the last odometry on, which is in the robot's own time.
        twist = getattr(message, "twist", message)
        now = streams.odom[-1][0] if streams.odom else math.nan
        command = (now, twist.linear.x, twist.angular.z)
        if _finite(command):
            streams.cmd_vel.append(command)
        return
    stamp = message.header.stamp
    time = stamp.sec + 1e-9 * stamp.nanosec
    pose, twist = _pose_of(message.pose.pose), message.twist.twist
    if topic == "ball":
        if _finite(pose):
            streams.ball.append((time, pose.x, pose.y))
    elif _finite(row := (time, *pose, twist.linear.x, twist.angular.z)):
        if not streams.goes_on_at(time):
            recorded.stretches.append(streams := _Streams())
        streams.odom.append(row)


def _drives(streams: _Streams, robot: Robot) -> Iterator[Episode]:
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
    """Give when (s) the robot stood still after its commands had ceased; `ceased` when it never did."""
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
        situation=Situation(action, state, first, goal),
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


def _ball_at(ball: FloatArray | None, time: float) -> BallState | None:
    if ball is None or time < ball[0, 0]:
        return None
    row = _at(ball, time)
    return BallState(float(row[1]), float(row[2]))


def _held(robot: Robot, pose: Pose, ball: BallState | None) -> bool:
    return ball is not None and robot.hold_point(pose).distance(Pose(ball.x, ball.y, 0.0)) <= HELD
