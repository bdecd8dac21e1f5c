"""Drives in recordings of odometry and velocity commands, or of an action server's goals.

Without goals of a server, a drive lies between two pauses of the commands, and its goal is where
the robot came to rest. The objects held at both ends determine the TOP, and so the point that the
goal is for.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from ator_ros.actions import DEFAULT_SET
from ator_ros.actions.base import Goal, Point
from ator_ros.actions.situation import Situation
from ator_ros.bases.description import Robot
from ator_ros.experience.records import ENDED, Vocabulary, episode_of
from ator_ros.experience.server_drives import (
    LONGEST,
    ODOMETRY_FRAME,
    ROBOT_FRAME,
    TF,
    TOO_LONG,
    Watch,
)
from ator_ros.experience.server_goals import ServerGoal
from ator_ros.experience.table import Episode
from ator_ros.experience.track import DIGITS, NOT_DRIVEN, PERIOD, ROUNDING, Segment, Track
from ator_ros.geometry import FloatArray
from ator_ros.printable import printable
from ator_ros.tops.chain import Top
from ator_ros.tops.objects import held_first, held_last, is_held
from ator_ros.world.readers import MessageError, ObjectReader, command_from
from ator_ros.world.sightings import JUMP
from ator_ros.world.state import ObjectState, RobotState, World

CMD_VEL = "cmd_vel"
RECORDS = "performance/action"
"""Roles of topics."""
PAUSE = 0.3  # s without a command to move that separates two drives
_CEASED = 1.0  # s without commands; within that time the watchdogs of most bases stop them
SHORTEST = 0.5  # s, the shortest drive
_MOST_NUMBERS = 10_000_000
"""Numbers of a recording that are kept, 80 MB: 7 h of odometry at 50 Hz and commands at 20 Hz."""
_MOST_RECORDS = 20_000
"""Records of a recording that are kept: a week of actions of 30 s."""
_MOST_SAMPLES = 300_000  # of all drives of a recording: 8 h of driving


class Reader:
    """Sorts the messages of a robot: segments, goals of action servers, the executor's records.

    A new segment begins after a reset or a long silence.

    Parameters
    ----------
    domain : Vocabulary
        Sources of the objects, remote actions, and the TOPs of drives and records.
    robot_in_tf : bool
        Whether tf replaces odometry.

    Attributes
    ----------
    records : list of Episode
        The records of actions that ended.
    action_sets : set of str
        The action sets of the records.
    left_out, errors : mapping
        By role: how many messages cannot be used, and why the first of them cannot.
    """

    def __init__(self, robot: Robot, domain: Vocabulary, *, robot_in_tf: bool = False) -> None:
        sources = [domain.source(name) for name in domain.objects]
        self._robot = robot
        self._domain = domain
        self._watch = Watch(robot, domain, robot_in_tf=robot_in_tf)
        self.records: list[Episode] = []
        self.action_sets: set[str] = set()
        self._remarks: list[str] = []
        self._robot_in_tf = robot_in_tf
        self._objects = {source.name: ObjectReader(source) for source in sources}
        self._in_tf = {
            source.name: source.topic_or_frame for source in sources if source.type == "tf"
        }
        self._counts: Counter[str] = Counter()
        self._numbers = 0
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
        try:
            if role == CMD_VEL:
                command = command_from(message, CMD_VEL)
                if newest.odom:  # a Twist has no stamp: it gets that of the last odometry message
                    speed = math.hypot(command.vx, command.vy)
                    newest.cmd_vel.append(self._watch.now, speed, command.w)
                    self._numbers += 3
            elif role == RECORDS:
                self.records.append(episode_of(message, self._domain, self._robot))
                self.action_sets.add(message.action_set or DEFAULT_SET)
            elif role in self._objects:
                reader = self._objects[role]
                reader.frame = self._watch.frame
                self._add_object(role, *reader.read(message))
            else:
                self._watch.add(role, message)
                if role in TF:
                    self._add_objects_in_tf()
        except MessageError as error:
            self.left_out[role] += 1
            self.errors.setdefault(role, str(error))

    @property
    def segments(self) -> list[Segment]:
        """In the order of time; messages are added to the last one."""
        return self._watch.segments

    @property
    def is_full(self) -> bool:
        """Whether no further messages may be added, which would need too much memory."""
        numbers = self._numbers + self._watch.numbers
        return numbers > _MOST_NUMBERS or len(self.records) >= _MOST_RECORDS

    @property
    def has_both(self) -> bool:
        """Whether the robot's states and commands to move are known."""
        return any(segment.odom and segment.cmd_vel for segment in self.segments)

    @property
    def has_goals(self) -> bool:
        """Whether there are goals of action servers."""
        return bool(self._watch.goals)

    def episodes(self) -> list[Episode]:
        """Return the executor's records, else the goals of action servers, else the drives."""
        if self.records:
            return self.records
        if episodes := self._server_episodes():
            return episodes
        found = (
            each for segment in self.segments for each in drives(segment, self._robot, self._domain)
        )
        return self._accepted("drives", (("", each) for each in found))

    def _accepted(self, what: str, found: Iterable[tuple[str, Episode | str]]) -> list[Episode]:
        """Return the episodes among what was found, and note why others are left out."""
        episodes: list[Episode] = []
        total: Counter[str] = Counter()
        rejected: Counter[tuple[str, str]] = Counter()
        hours = _MOST_SAMPLES * PERIOD / 3600.0
        count = 0
        for name, each in found:
            total[name] += 1
            if isinstance(each, str):
                rejected[name, each] += 1
                continue
            count += 0 if each.samples is None else len(each.samples)
            if count > _MOST_SAMPLES:
                too_long = f"expected at most {hours:.0f} h of driving: split the recording"
                rejected[name, too_long] += 1
            else:
                episodes.append(each)
        for (name, reason), count in rejected.most_common():
            of = f" of {name}" if name else ""
            self._remarks.append(f"left out {count} of {total[name]} {what}{of}: {reason}")
        return episodes

    def remarks(self) -> list[str]:
        """Return remarks about doubtful messages and those that were left out."""
        left_out = []
        for role, count in self.left_out.items():
            what = "records" if role == RECORDS else "messages"
            left_out.append(f"left out {count} of {self._counts[role]} {what}: {self.errors[role]}")
        return [*self._doubts(), *self._remarks, *left_out]

    def _doubts(self) -> Iterator[str]:
        """Yield remarks about what all messages show together."""
        states = [segment for segment in self.segments if segment.odom]
        if self.is_full:
            yield (
                f"read only the first {self._counts.total():,} messages: expected at most "
                f"{_MOST_NUMBERS // 10**6} million numbers and {_MOST_RECORDS:,} records; "
                "split the recording"
            )
        same = [segment for segment in states if segment.odom.first[0] == segment.odom.last[0]]
        if len(states) == len(same) == 1 and len(same[0].odom) > 1:
            yield (
                "odom.header.stamp: expected stamps that increase, got "
                f"{same[0].odom.last[0]:g} s in all {len(same[0].odom)} messages: "
                "the driver has to set them"
            )
        if self._robot_in_tf and not states and self._watch.has_frames:
            frames = ", ".join(printable(name) for name in self._watch.transforms.frames[:8])
            yield (
                f"tf: expected {ROBOT_FRAME}, or a single frame, in {ODOMETRY_FRAME}; "
                f"got the frames {frames}"
            )
        if self.records:  # then odometry is not used
            return
        corrected = sorted(set().union(*(each.track.corrected for each in states)))
        if corrected:
            names = " and ".join(corrected)
            yield f"odom: {names} and poses contradict each other; the poses decide"

    def _server_episodes(self) -> list[Episode]:
        """Return the goals that action servers executed.

        Note how many others there are, and why.
        """
        return self._accepted("goals", self._legs())

    def _legs(self) -> Iterator[tuple[str, Episode | str]]:
        """Yield action and episode of each goal, or of its legs; or why it is none."""
        watch = self._watch
        for goal in watch.goals:
            track = _track_of(goal)
            legs = watch.legs(goal, track=track)
            if isinstance(legs, str):
                yield goal.action, legs
                continue
            for leg in legs:
                yield leg.action, watch.rejection(leg) or watch.episode(leg, track=track)

    def _add_objects_in_tf(self) -> None:
        for name, frame in self._in_tf.items():
            found = self._watch.transforms.latest(self._watch.frame, frame)
            rows = self.segments[-1].objects[name]
            if found is not None and not (rows and found[0] == rows.last[0]):
                self._add_object(name, *self._objects[name].read_placement(*found))

    def _add_object(self, name: str, time: float, state: ObjectState) -> None:
        odom = self.segments[-1].odom
        if odom and abs(time - odom.last[0]) > JUMP:
            raise MessageError(
                f"{name}.header.stamp: expected about odometry's {odom.last[0]:.2f} s, "
                f"got {time:.2f} s: another clock"
            )
        self.segments[-1].objects[name].append(time, state.x, state.y)
        self._numbers += 3


def drives(segment: Segment, robot: Robot, domain: Vocabulary) -> Iterator[Episode | str]:
    """Yield the drives of a segment as successful episodes, or why they cannot be used.

    The TOPs of `domain` determine the actions; if none of them drives, there are no drives.
    """
    if not segment.odom or not segment.cmd_vel:
        return
    track = segment.track
    for begin, ceased in _spans(segment.cmd_vel.in_order(), track):
        end = _rest(track, ceased)
        if end - begin >= SHORTEST and track.begin <= begin and end <= track.end:
            came_to_rest = min(end + PAUSE, track.end)
            unusable = TOO_LONG if end - begin > LONGEST else ""
            if unusable := unusable or track.jump(robot, begin, came_to_rest):
                yield unusable
                continue
            goal_pose = track.world(came_to_rest).robot.pose
            start = track.world(begin)
            last = track.world(end)
            at_goal = dataclasses.replace(last, robot=RobotState(goal_pose))
            top = top_between(domain.tops, _held(robot, start), _held(robot, at_goal))
            if top is not None:
                place = robot.hold_point(goal_pose) if top.point is Point.HOLD else goal_pose
                goal = Goal(place, 0.0, top.point)
                yield Episode(
                    Situation(top.action, start.robot, start.objects, goal),
                    round(end - begin, DIGITS),
                    True,
                    "recorded: its goal is where it came to rest",
                    math.nan,
                    math.nan,
                    samples=track.samples(begin, end, start.objects),
                )


def _track_of(goal: ServerGoal) -> Track | None:
    """Return the track of a goal's segment, which is made once for all goals in it."""
    return None if goal.segment is None or not goal.segment.odom else goal.segment.track


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
        if begin is not None and end is not None and time - end >= PAUSE - ROUNDING:
            yield begin, end
            begin = None
        if moves:
            begin = time if begin is None else begin
            end = None
    if begin is not None and end is not None:
        yield begin, end


def _rest(track: Track, ceased: float) -> float:
    """Return when (s) the robot came to rest after its commands ceased; `ceased` if it did not."""
    after = track.between(ceased, ceased + PAUSE + ROUNDING)
    still = NOT_DRIVEN.holds(np.hypot(after[:, 4], after[:, 6]), after[:, 5])
    return float(after[still][0, 0]) if still.any() else ceased


def top_between(tops: Sequence[Top], first: str | None, last: str | None) -> Top | None:
    """Return the TOP that drives with the objects held at its start and end, or None.

    Without one, it is the first TOP that drives without an object.
    """
    driving = {(held_first(top), held_last(top)): top for top in reversed(tops) if top.arrives}
    return driving.get((first, last)) or driving.get((None, None))


def _held(robot: Robot, world: World) -> str | None:
    """Return the first object that the robot holds, or None."""
    return next((name for name in world.objects if is_held(world, robot, name)), None)
