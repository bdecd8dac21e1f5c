"""Drives in recordings of odometry and velocity commands, or of an action server's goals.

Without goals of a server, a drive lies between two pauses of the commands, and its goal is where
the robot came to rest. The objects held at both ends determine the TOP, and so the point that the
goal is for.
"""

from __future__ import annotations

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
from ator_ros.experience.episode import Episode
from ator_ros.experience.records import ENDED, Vocabulary, episode_of, fault_in
from ator_ros.experience.server_goals import GOAL_POSE, PLAN, ServerGoal, ServerGoals, status_topics
from ator_ros.geometry import FloatArray, Pose, wrap_angle, wrap_angles
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
_ROUNDING, _DIGITS = 1e-6, 6  # s, and digits of s; stamps since 1970 are rounded to 0.24 us


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

    Parameters
    ----------
    domain : Vocabulary
        Sources of the objects, remote actions, and the TOPs of drives and records.
    robot_in_tf : bool
        Whether tf replaces odometry.

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
        self._in_tf = {
            source.name: source.topic_or_frame for source in sources if source.type == "tf"
        }
        self._transforms = Transforms()
        self._servers = status_topics(domain)
        self._goals = ServerGoals(self._odom_pose_in)
        self._velocity = RobotVelocity(robot.limits.v, robot.limits.w)
        self._is_older = False
        self._counts: Counter[str] = Counter()
        self.left_out: Counter[str] = Counter()
        self.errors: dict[str, str] = {}

    def add(self, role: str, message: Any) -> None:
        """Add a record, or a message of odometry, commands, tf or an object.

        Count it if it is unusable.
        """
        if role == RECORDS and message.outcome.code not in ENDED:
            return
        self._counts[role] += 1
        newest = self.segments[-1]
        now, *pose = newest.odom[-1][:4] if newest.odom else (math.nan,) * 4
        try:
            if role == ODOM:
                self._add_state(*self._odometry.read(message))
                if self._odometry.remark:
                    self._remarks.append(self._odometry.remark)
            elif role == CMD_VEL:
                command = command_from(message, CMD_VEL)
                if newest.odom:  # a Twist has no stamp: it gets that of the last odometry message
                    newest.cmd_vel.append((now, command.v, command.w))
            elif role == RECORDS:
                self.records.append(episode_of(message, self._domain, self._robot))
                self.action_sets.add(message.action_set or DEFAULT_SET)
            elif role in TF:
                self._add_transforms(message, fixed=role == "tf_static")
            elif role in self._servers:
                number = len(self.segments) - 1
                self._goals.add_status(self._servers[role], message, number, now, Pose(*pose))
            elif role in (PLAN, GOAL_POSE):
                self._goals.add_pose(message, now)
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
            or [
                each
                for segment in self.segments
                for each in drives(segment, self._robot, self._domain)
            ]
        )

    def remarks(self) -> list[str]:
        """Return remarks about doubtful messages, and about messages that were left out, by role."""
        left_out = (
            f"left out {count} of {self._counts[role]} {'records' if role == RECORDS else 'messages'}: "
            f"{self.errors[role]}"
            for role, count in self.left_out.items()
        )
        return [*self._remarks, *left_out]

    def _server_episodes(self) -> list[Episode]:
        """Return the goals that action servers executed.

        Note how many others there are, and why.
        """
        goals, episodes, rejected = (
            self._goals.goals.values(),
            list[Episode](),
            Counter[tuple[str, str]](),
        )
        for goal in goals:
            found = goal.rejection() or self._server_episode(goal)
            if isinstance(found, Episode):
                episodes.append(found)
            else:
                rejected[goal.action, found] += 1
        total = Counter(goal.action for goal in goals)
        self._remarks += [
            f"left out {count} of {total[action]} goals of {action}: {reason}"
            for (action, reason), count in rejected.items()
        ]
        return episodes

    def _server_episode(self, goal: ServerGoal) -> Episode | str:
        """Return the episode of a server's goal, in the goal's frame, or why it cannot be used."""
        segment, robot = self.segments[goal.segment], self._robot
        if segment is not self.segments[-1] and goal.end == segment.odom[-1][0]:
            return "odometry was interrupted"
        top = next((top for top in self._domain.tops if top.action == goal.action), None)
        if top is None or goal.pose is None or goal.odom_pose is None:
            return "no TOP calls the action"
        track, errors = segment.track.seen_from(goal.odom_pose), (math.nan, math.nan)
        if goal.final_pose is not None:
            reached = (
                robot.hold_point(goal.final_pose) if top.point is Point.HOLD else goal.final_pose
            )
            errors = reached.distance(goal.pose), abs(wrap_angle(reached.yaw - goal.pose.yaw))
        start = track.world(goal.begin)
        situation = Situation(
            goal.action, start.robot, start.objects, Goal(goal.pose, 0.0, top.point)
        )
        success, reason = goal.status == "succeeded", f"recorded: its server reported {goal.status}"
        samples, duration = (
            track.samples(goal.begin, goal.end),
            round(goal.end - goal.begin, _DIGITS),
        )
        episode = Episode(
            situation, samples, duration, success, reason, *errors, tuple(track.objects)
        )
        too_far = fault_in(episode, top, robot)
        return "the goal is farther than the robot drives in its duration" if too_far else episode

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

    def _add_transforms(self, message: Any, *, fixed: bool) -> None:
        for transform in message.transforms:
            parent, child, time, placement = transform_from(transform)
            self._transforms.add(parent, child, time, placement, fixed=fixed)
        if self._robot_in_tf and (
            found := self._transforms.latest(self._odometry.frame, _ROBOT_FRAME)
        ):
            self._add_state(*robot_from_placement(self._velocity, *found))
        for name, frame in self._in_tf.items():
            found = self._transforms.latest(self._odometry.frame, frame)
            rows = self.segments[-1].objects[name]
            if found is not None and not (rows and found[0] == rows[-1][0]):
                self._add_object(name, *self._objects[name].read_placement(*found))

    def _odom_pose_in(self, frame: str) -> Pose | None:
        """Return the pose of odometry's frame in another frame, by the newest transforms."""
        if frame in ("", self._odometry.frame):
            return Pose(0.0, 0.0, 0.0)
        found = self._transforms.latest(frame, self._odometry.frame)
        return (
            None
            if found is None
            else pose_from_placement(found[1], f"{self._odometry.frame} in tf")
        )

    def _add_object(self, name: str, time: float, state: ObjectState) -> None:
        odom = self.segments[-1].odom
        if odom and abs(time - odom[-1][0]) > JUMP:
            raise MessageError(
                f"{name}.header.stamp: expected about odometry's {odom[-1][0]:.2f} s, got {time:.2f} s: "
                "another clock"
            )
        self.segments[-1].objects[name].append((time, state.x, state.y))


class Track:
    """The states in a segment with odometry, interpolated between the messages.

    Attributes
    ----------
    odom : ndarray, shape (n, 6)
        t, x, y, yaw, v, w in the order of time, with unwrapped yaw.
    begin, end : float
        Times in s of the first and the last odometry.
    objects : mapping of str to ndarray, shape (n, 3)
        t, x, y of each object with messages.
    """

    def __init__(self, segment: Segment) -> None:
        self.odom = _in_order(segment.odom, 6)
        self.odom[:, 3] = np.unwrap(self.odom[:, 3])
        self.objects = {name: _in_order(rows, 3) for name, rows in segment.objects.items() if rows}
        self._odom_pose = Pose(0.0, 0.0, 0.0)
        self.begin, self.end = float(self.odom[0, 0]), float(self.odom[-1, 0])
        self._rows = [
            np.vstack([np.round(table[:, 0] - self.begin, _DIGITS), table.T[1:]])
            for table in (self.odom, *self.objects.values())
        ]

    def seen_from(self, odom_pose: Pose) -> Track:
        """Return it in the frame in which odometry's frame is at `odom_pose`.

        The tables stay as they are.
        """
        other = copy.copy(self)
        other._odom_pose = odom_pose
        return other

    def states(self, times: FloatArray) -> FloatArray:
        """Return the states at times (n,) in s, one a row: t, x, y, yaw, v, w, then x, y of each object.

        Objects are NaN before their first message.
        """
        since = np.round(times - self.begin, _DIGITS)
        columns = [
            np.interp(since, stamps, row, left=np.nan)
            for stamps, *rows in self._rows
            for row in rows
        ]
        states, (x, y, yaw) = np.column_stack([times, *columns]), self._odom_pose
        turn = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
        for first in (1, *range(6, states.shape[1], 2)):
            states[:, first : first + 2] = states[:, first : first + 2] @ turn + (x, y)
        states[:, 3] = wrap_angles(states[:, 3] + yaw)
        return states

    def world(self, time: float) -> World:
        """Return the state at `time` (s), with the objects that had a message by then."""
        _, x, y, yaw, v, w, *places = self.states(np.array([time]))[0].tolist()
        found = zip(self.objects, places[::2], places[1::2], strict=True)
        objects = {name: ObjectState(*place) for name, *place in found if not math.isnan(place[0])}
        return World(time, RobotState(Pose(x, y, yaw), v, w), objects)

    def samples(self, begin: float, end: float) -> FloatArray:
        """Return the samples of an episode from `begin` to `end` (s); see `Episode`."""
        times: FloatArray = PERIOD * np.arange(
            int((end - begin - _ROUNDING) / PERIOD) + 1, dtype=float
        )
        return np.column_stack([times, self.states(begin + times)[:, 1:]])

    def stood(self, since: float, until: float) -> bool:
        """Return whether the robot stood at any time between two (s)."""
        times = self.odom[:, 0]
        during = self.odom[np.searchsorted(times, since, "right") : np.searchsorted(times, until)]
        return bool(NOT_DRIVEN.holds(during[:, 4], during[:, 5]).any())


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
            goal_pose = track.world(min(end + PAUSE, track.end)).robot.pose
            start, last = track.world(begin), track.world(end)
            at_goal = dataclasses.replace(last, robot=RobotState(goal_pose))
            top = top_between(domain.tops, _held(robot, start), _held(robot, at_goal))
            if top is not None:
                place = robot.hold_point(goal_pose) if top.point is Point.HOLD else goal_pose
                goal, why = (
                    Goal(place, 0.0, top.point),
                    "recorded: its goal is where it came to rest",
                )
                situation = Situation(top.action, start.robot, start.objects, goal)
                samples, duration = track.samples(begin, end), round(end - begin, _DIGITS)
                unknown = math.nan, math.nan
                yield Episode(
                    situation, samples, duration, True, why, *unknown, tuple(track.objects)
                )


def _spans(commands: FloatArray, track: Track) -> Iterator[tuple[float, float]]:
    """Yield begin and end (s) of the times in which the robot was commanded to move.

    If commands cease without a stop, and the robot stood before the next command, its goal is
    unknown and the drive is left out.
    """
    moving = ~NOT_DRIVEN.holds(commands[:, 1], commands[:, 2])
    begin: float | None = None
    end: float | None = None
    last = 0.0
    for time, moves in zip(commands[:, 0].tolist(), moving.tolist(), strict=True):
        if end is None and time - last > _CEASED and track.stood(last, time):
            begin = None
        last = time
        if end is None and not moves:
            end = time
        if begin is not None and end is not None and time - end >= PAUSE - _ROUNDING:
            yield begin, end
            begin = None
        if moves:
            begin, end = time if begin is None else begin, None
    if begin is not None and end is not None:
        yield begin, end


def _rest(track: Track, ceased: float) -> float:
    """Return when (s) the robot came to rest after its commands ceased; `ceased` if it did not."""
    times = track.odom[:, 0]
    last = ceased + PAUSE + _ROUNDING
    after = track.odom[np.searchsorted(times, ceased) : np.searchsorted(times, last, "right")]
    still = NOT_DRIVEN.holds(after[:, 4], after[:, 5])
    return float(after[still][0, 0]) if still.any() else ceased


def top_between(tops: Sequence[Top], first: str | None, last: str | None) -> Top | None:
    """Return the TOP that drives, with the object `first` held at its start and `last` at its end, or None.

    If there is none, it is the first TOP that drives without an object.
    """
    driving = {(held_first(top), held_last(top)): top for top in reversed(tops) if top.arrives}
    return driving.get((first, last)) or driving.get((None, None))


def _held(robot: Robot, world: World) -> str | None:
    """Return the first object that the robot holds, or None."""
    return next((name for name in world.objects if is_held(world, robot, name)), None)
