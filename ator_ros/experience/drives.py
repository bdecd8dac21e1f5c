"""Drives in recordings of odometry and velocity commands, or of an action server's goals.

Without goals, a drive lies between two pauses of the commands, and its goal is where the robot came to rest.
The objects held at both ends determine the TOP of the domain and the point that the goal is meant for.
"""

from __future__ import annotations

import bisect
import copy
import dataclasses
import math
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ator_ros.actions import DEFAULT_SET
from ator_ros.actions.base import Goal, Point
from ator_ros.actions.situation import Situation
from ator_ros.experience.episode import Episode, sample_of
from ator_ros.experience.records import ENDED, Vocabulary, episode_of, fault_in
from ator_ros.experience.server_goals import GOAL_POSE, PLAN, ServerGoal, ServerGoals, status_topics
from ator_ros.geometry import FloatArray, Pose, wrap_angle
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import Top
from ator_ros.tops.objects import held_first, held_last, is_held
from ator_ros.world.estimation import JUMP, RobotVelocity
from ator_ros.world.messages import (
    MessageError,
    ObjectReader,
    OdometryReader,
    command_from,
    pose_from_placement,
    robot_from_placement,
    transform_from,
)
from ator_ros.world.state import ObjectState, RobotState, Standstill, World
from ator_ros.world.transforms import Transforms

ODOM, CMD_VEL, RECORDS = "odom", "cmd_vel", "performance/action"
TF = ("tf", "tf_static")
"""Roles of topics."""
_ODOMETRY_FRAME, _ROBOT_FRAME = "odom", "base_link"  # REP-105
SILENCE = 1.0  # s without odometry after which a new segment begins
PERIOD = 0.1  # s between examples, the paper's 10 Hz
PAUSE = 0.3  # s without a command to move that separates two drives
_CEASED = 1.0  # s without commands; within that time the watchdogs of most bases stop them
SHORTEST = 0.5  # s, the shortest drive
NOT_DRIVEN = Standstill(0.01, 0.02)
"""Greatest speeds of a command to stop, and greatest measured speeds of a robot at rest."""
Rows = list[tuple[float, ...]]
"""Rows of numbers, the time in s first."""
_ROUNDING = 1e-6  # s; stamps since 1970 are rounded to 0.24 us


@dataclass
class Segment:
    """Recorded without a gap: odom (t, x, y, yaw, v, w), commands (t, v, w), objects (t, x, y)."""

    odom: Rows = field(default_factory=list)
    cmd_vel: Rows = field(default_factory=list)
    objects: dict[str, Rows] = field(default_factory=lambda: defaultdict(list))

    @cached_property
    def track(self) -> Track:
        """The states in it, once all messages are there."""
        return Track(self)


def _in_order(rows: Rows, width: int) -> FloatArray:
    """Return rows as a table (n, width) in the order of their times."""
    table = np.array(rows, dtype=float).reshape(-1, width)
    return table[np.argsort(table[:, 0], kind="stable")]


class Reader:
    """Sorts the messages of a robot: its segments, the goals of action servers, and the executor's records.

    A new segment begins after a reset or a long silence.

    `domain` has the sources of the objects, the remote actions, and the TOPs of drives and records;
    `robot_in_tf`: tf replaces odometry.

    Attributes
    ----------
    segments : list of Segment
        In the order of time; messages are added to the last one.
    records : list of Episode
        The records of actions that ended.
    action_sets : set of str
        The action sets of the records.
    left_out, errors : mapping
        By role: how many messages cannot be used, and why the first of them cannot.
    """

    def __init__(self, robot: Robot, domain: Vocabulary, *, robot_in_tf: bool = False) -> None:
        sources = [domain.source(name) for name in domain.objects]
        self._robot, self._domain = robot, domain
        self.segments = [Segment()]
        self.records: list[Episode] = []
        self.action_sets: set[str] = set()
        self._remarks: list[str] = []
        self._robot_in_tf = robot_in_tf
        self._odometry = OdometryReader(_ODOMETRY_FRAME if robot_in_tf else "")
        self._objects = {source.name: ObjectReader(source) for source in sources}
        self._in_tf = {source.name: source.topic_or_frame for source in sources if source.type == "tf"}
        self._transforms = Transforms()
        self._servers = status_topics(domain)
        self._goals = ServerGoals(self._odometry_in)
        self._velocity = RobotVelocity(robot.limits.v, robot.limits.w)
        self._is_older = False
        self._taken: Counter[str] = Counter()
        self.left_out: Counter[str] = Counter()
        self.errors: dict[str, str] = {}

    def take(self, role: str, message: Any) -> None:
        """Add a record, or a message of odometry, commands, tf or an object; count it if it is unusable."""
        if role == RECORDS and message.outcome.code not in ENDED:
            return
        self._taken[role] += 1
        newest = self.segments[-1]
        now, *there = newest.odom[-1][:4] if newest.odom else (math.nan,) * 4
        try:
            if role == ODOM:
                self._take_odometry(message)
            elif role == CMD_VEL:
                command = command_from(message, CMD_VEL)
                if newest.odom:  # a Twist has no stamp: it gets that of the last odometry message
                    newest.cmd_vel.append((now, command.v, command.w))
            elif role == RECORDS:
                self.records.append(episode_of(message, self._domain, self._robot))
                self.action_sets.add(message.action_set or DEFAULT_SET)
            elif role in TF:
                self._take_transforms(message, fixed=role == "tf_static")
            elif role in self._servers:
                action, number = self._servers[role], len(self.segments) - 1
                self._goals.take_status(action, message, number, now, Pose(*there))
            elif role in (PLAN, GOAL_POSE):
                self._goals.take_goal(message, now)
            else:
                reader = self._objects[role]
                reader.frame = self._odometry.frame
                self._add_object(role, *reader.read(message))
        except MessageError as error:
            self.left_out[role] += 1
            self.errors.setdefault(role, str(error))

    def episodes(self) -> list[Episode]:
        """Return the executor's records or, without any, the goals of action servers or else the drives."""
        return (
            self.records
            or self._server_episodes()
            or [each for segment in self.segments for each in drives(segment, self._robot, self._domain)]
        )

    def _server_episodes(self) -> list[Episode]:
        """Return the goals that action servers executed; note how many others there are, and why."""
        episodes, faults, total = list[Episode](), Counter[tuple[str, str]](), Counter[str]()
        for item in self._goals.goals.values():
            total[item.action] += 1
            fault = item.fault() or self._take_goal(item, episodes)
            if fault:
                faults[item.action, fault] += 1
        self._remarks += [
            f"left out {count} of {total[action]} goals of {action}: {fault}"
            for (action, fault), count in faults.items()
        ]
        return episodes

    def _take_goal(self, item: ServerGoal, episodes: list[Episode]) -> str:
        """Add the episode of a goal, in the goal's frame; return why it cannot be used, or ""."""
        segment, robot = self.segments[item.segment], self._robot
        if segment is not self.segments[-1] and item.end == segment.odom[-1][0]:
            return "odometry was interrupted"
        top = next((top for top in self._domain.tops if top.action == item.action), None)
        if top is None or item.pose is None or item.base is None:
            return "no TOP calls the action"
        track, errors = segment.track.seen_from(item.base), (math.nan, math.nan)
        if item.reached is not None:
            reached = robot.hold_point(item.reached) if top.point is Point.HOLD else item.reached
            errors = reached.distance(item.pose), abs(wrap_angle(reached.yaw - item.pose.yaw))
        start, goal = track.world(item.begin), Goal(item.pose, 0.0, top.point)
        situation = Situation(item.action, start.robot, start.objects, goal)
        success, reason = item.status == "succeeded", f"recorded: its server reported {item.status}"
        episode = _driven(track, item.begin, item.end, situation, success, reason, errors)
        if fault_in(episode, top, robot):
            return "the goal is farther than the robot drives in its duration"
        episodes.append(episode)
        return ""

    def remarks(self) -> list[str]:
        """Return doubts about messages, and a line for each role of which messages were left out."""
        left_out = (
            f"left out {count} of {self._taken[role]} {'records' if role == RECORDS else 'messages'}: "
            f"{self.errors[role]}"
            for role, count in self.left_out.items()
        )
        return [*self._remarks, *left_out]

    def _take_odometry(self, message: Any) -> None:
        time, robot = self._odometry.read(message)
        if self._odometry.remark:
            self._remarks.append(self._odometry.remark)
        self._add_state(time, robot)

    def _add_state(self, time: float, robot: RobotState) -> None:
        odom = self.segments[-1].odom
        last = odom[-1][0] if odom else time
        if time < last and not self._is_older:
            self._is_older = True  # one late message is ignored, two in a row are a reset
            return
        self._is_older = False
        if odom and not 0.0 <= time - last <= SILENCE:
            self.segments.append(Segment())
        self.segments[-1].odom.append((time, *robot.pose, robot.v, robot.w))

    def _take_transforms(self, message: Any, *, fixed: bool) -> None:
        for transform in message.transforms:
            parent, child, time, placement = transform_from(transform)
            self._transforms.add(parent, child, time, placement, fixed=fixed)
        if self._robot_in_tf and (found := self._transforms.latest(self._odometry.frame, _ROBOT_FRAME)):
            self._add_state(*robot_from_placement(self._velocity, *found))
        for name, frame in self._in_tf.items():
            found = self._transforms.latest(self._odometry.frame, frame)
            rows = self.segments[-1].objects[name]
            if found is not None and not (rows and found[0] == rows[-1][0]):
                self._add_object(name, *self._objects[name].read_placement(*found))

    def _odometry_in(self, frame: str) -> Pose | None:
        """Return the pose of odometry's frame in another frame, by the newest transforms."""
        if frame in ("", self._odometry.frame):
            return Pose(0.0, 0.0, 0.0)
        found = self._transforms.latest(frame, self._odometry.frame)
        return None if found is None else pose_from_placement(found[1], f"{self._odometry.frame} in tf")

    def _add_object(self, name: str, time: float, there: ObjectState) -> None:
        odom = self.segments[-1].odom
        if odom and abs(time - odom[-1][0]) > JUMP:
            raise MessageError(
                f"{name}.header.stamp: expected about odometry's {odom[-1][0]:.2f} s, got {time:.2f} s: "
                "another clock"
            )
        self.segments[-1].objects[name].append((time, there.x, there.y))


class Track:
    """The state at any time of a segment with odometry, interpolated.

    Attributes
    ----------
    odom : ndarray, shape (n, 6)
        In the order of time, with unwrapped yaw.
    begin, end : float
        Times in s of the first and the last odometry.
    names : tuple of str
        The objects with messages.
    """

    def __init__(self, segment: Segment) -> None:
        self.odom = _in_order(segment.odom, 6)
        self.odom[:, 3] = np.unwrap(self.odom[:, 3])
        self._objects = {name: _in_order(rows, 3) for name, rows in segment.objects.items() if rows}
        self._base = Pose(0.0, 0.0, 0.0)
        self.begin, self.end = float(self.odom[0, 0]), float(self.odom[-1, 0])
        self.names = tuple(self._objects)

    def seen_from(self, base: Pose) -> Track:
        """Return it in the frame in which odometry's frame is at `base`; `odom` stays as it is."""
        other = copy.copy(self)
        other._base = base
        return other

    def world(self, time: float) -> World:
        """Return the state at `time` (s), with the objects that had a message by then."""
        _, *pose, v, w = _at(self.odom, time).tolist()
        there = {name: _at(table, time) for name, table in self._objects.items() if time >= table[0, 0]}
        places = {name: Pose(float(row[1]), float(row[2]), 0.0) for name, row in there.items()}
        objects = {name: ObjectState(*self._base.compose(place)[:2]) for name, place in places.items()}
        return World(time, RobotState(self._base.compose(Pose(*pose)), v, w), objects)

    def stood(self, since: float, until: float) -> bool:
        """Return whether the robot stood at any time between two (s)."""
        times = self.odom[:, 0]
        during = self.odom[np.searchsorted(times, since, "right") : np.searchsorted(times, until)]
        return bool(NOT_DRIVEN.holds(during[:, 4], during[:, 5]).any())

    def samples(self, begin: float, end: float) -> FloatArray:
        """Return the samples of an episode from `begin` to `end` (s); see `Episode`."""
        times = [begin + number * PERIOD for number in range(int((end - begin - _ROUNDING) / PERIOD) + 1)]
        rows = [
            (number * PERIOD, *sample_of(self.world(time), begin, self.names)[1:])
            for number, time in enumerate(times)
        ]
        return np.array(rows, dtype=float)


def _at(table: FloatArray, time: float) -> FloatArray:
    """Return the row at `time` (s), interpolated unless a stamp is the same up to rounding."""
    after = bisect.bisect_right(table[:, 0], time + _ROUNDING)
    if after > 0 and table[after - 1, 0] >= time - _ROUNDING:
        return np.asarray(table[after - 1])
    rows = table[max(0, after - 1) : after + 1]  # the neighbors
    return np.array([np.interp(time, rows[:, 0], column) for column in rows.T])


def drives(segment: Segment, robot: Robot, domain: Vocabulary) -> Iterator[Episode]:
    """Yield the drives of a segment as successful episodes.

    The TOPs of `domain` determine the actions; if none of them drives, there are no drives.
    """
    if not segment.odom or not segment.cmd_vel:
        return
    track = segment.track
    for begin, ceased in _spans(_in_order(segment.cmd_vel, 3), track):
        end = _rest(track, ceased)
        if end - begin >= SHORTEST and track.begin <= begin and end <= track.end:
            # The goal is where the robot comes to rest in the pause.
            goal_pose = track.world(min(end + PAUSE, track.end)).robot.pose
            start, last = track.world(begin), track.world(end)
            at_goal = dataclasses.replace(last, robot=RobotState(goal_pose))
            top = top_between(domain.tops, _held(robot, start), _held(robot, at_goal))
            if top is not None:
                place = robot.hold_point(goal_pose) if top.point is Point.HOLD else goal_pose
                situation = Situation(top.action, start.robot, start.objects, Goal(place, 0.0, top.point))
                why = "recorded: its goal is where it came to rest"
                yield _driven(track, begin, end, situation, True, why)


def _spans(commands: FloatArray, track: Track) -> Iterator[tuple[float, float]]:
    """Yield begin and end (s) of the times in which the robot was commanded to move.

    If commands cease without a stop, and the robot stood before the next command, its goal is unknown and the
    drive is left out.
    """
    moving = ~NOT_DRIVEN.holds(commands[:, 1], commands[:, 2])
    begin: float | None = None
    end = last = 0.0
    for time, moves in zip(commands[:, 0].tolist(), moving.tolist(), strict=True):
        if begin is not None and end < begin and time - last > _CEASED and track.stood(last, time):
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


def _rest(track: Track, ceased: float) -> float:
    """Return when (s) the robot came to rest after its commands ceased; `ceased` if it did not."""
    times = track.odom[:, 0]
    last = ceased + PAUSE + _ROUNDING
    after = track.odom[np.searchsorted(times, ceased) : np.searchsorted(times, last, "right")]
    still = NOT_DRIVEN.holds(after[:, 4], after[:, 5])
    return float(after[still][0, 0]) if still.any() else ceased


def _driven(
    track: Track,
    begin: float,
    end: float,
    situation: Situation,
    success: bool,
    reason: str,
    errors: tuple[float, float] = (math.nan, math.nan),
) -> Episode:
    samples, duration = track.samples(begin, end), round(end - begin, 6)
    return Episode(situation, samples, duration, success, reason, *errors, objects=track.names)


def top_between(tops: Sequence[Top], first: str | None, last: str | None) -> Top | None:
    """Return the TOP that drives with `first` (an object, or None) held at its start, and `last` at its end.

    Without any, it is the first that drives and holds nothing.
    """
    driving = {(held_first(top), held_last(top)): top for top in reversed(tops) if top.arrives}
    return driving.get((first, last)) or driving.get((None, None))


def _held(robot: Robot, world: World) -> str | None:
    """Return the first object that the robot holds, or None."""
    return next((name for name in world.objects if is_held(world, robot, name)), None)
