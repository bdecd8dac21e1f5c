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
from ator_ros.experience.records import ENDED, Vocabulary, episode_of, fault_in
from ator_ros.experience.server_goals import (
    GOAL_POSE,
    NOT_CONNECTED,
    PLAN,
    ServerGoal,
    ServerGoals,
    status_topics,
)
from ator_ros.experience.table import Episode
from ator_ros.experience.track import DIGITS, NOT_DRIVEN, PERIOD, ROUNDING, WIDTH, Segment, Track
from ator_ros.geometry import FloatArray, Pose, wrap_angle
from ator_ros.printable import printable, quoted
from ator_ros.tops.chain import Top
from ator_ros.tops.objects import held_first, held_last, is_held
from ator_ros.world.readers import (
    MessageError,
    ObjectReader,
    OdometryReader,
    command_from,
    pose_from_placement,
    robot_from_placement,
    transform_from,
)
from ator_ros.world.robot_velocity import RobotVelocity
from ator_ros.world.sightings import JUMP
from ator_ros.world.state import ObjectState, RobotState, World
from ator_ros.world.transforms import Transforms

ODOM = "odom"
CMD_VEL = "cmd_vel"
RECORDS = "performance/action"
TF = ("tf", "tf_static")
"""Roles of topics."""
_ODOMETRY_FRAME = "odom"  # REP-105
_ROBOT_FRAME = "base_link"  # REP-105
SILENCE = 1.0  # s without odometry after which a new segment begins
PAUSE = 0.3  # s without a command to move that separates two drives
_CEASED = 1.0  # s without commands; within that time the watchdogs of most bases stop them
SHORTEST = 0.5  # s, the shortest drive
_MOST_NUMBERS = 10_000_000
"""Numbers of a recording that are kept, 80 MB: 7 h of odometry at 50 Hz and commands at 20 Hz."""
_MOST_RECORDS = 20_000
"""Records of a recording that are kept: a week of actions of 30 s."""
_MOST_SAMPLES = 300_000  # of all drives of a recording: 8 h of driving
_LONGEST = 3600.0  # s, the longest drive
_MOST_FRAMES = 1000  # in tf: far more than a robot has
_LONGEST_NAME = 256  # characters of a frame in tf
_SEGMENT = 100  # numbers that need as much memory as a segment without messages
_TOO_LONG = f"expected at most {_LONGEST:.0f} s"


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
        self._robot = robot
        self._domain = domain
        self.segments = [Segment()]
        self.records: list[Episode] = []
        self.action_sets: set[str] = set()
        self._remarks: list[str] = []
        self._robot_in_tf = robot_in_tf
        self._odometry = OdometryReader(
            _ODOMETRY_FRAME if robot_in_tf else "", corrects=False, sideways=robot.moves_sideways
        )
        self._objects = {source.name: ObjectReader(source) for source in sources}
        self._in_tf = {
            source.name: source.topic_or_frame for source in sources if source.type == "tf"
        }
        self._transforms = Transforms()
        self._servers = status_topics(domain)
        self._goals = ServerGoals(self._odom_pose_in)
        self._velocity = RobotVelocity(
            robot.greatest_speed(), robot.greatest_turn_rate, sideways=robot.moves_sideways
        )
        self._is_older = False
        self._counts: Counter[str] = Counter()
        self._numbers = 0
        self._parents: dict[str, str] = {}
        """By frame in tf, its parent."""
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
        now, *pose = newest.odom.last[:4] if newest.odom else (math.nan,) * 4
        try:
            if role == ODOM:
                self._add_state(*self._odometry.read(message))
            elif role == CMD_VEL:
                command = command_from(message, CMD_VEL)
                if newest.odom:  # a Twist has no stamp: it gets that of the last odometry message
                    newest.cmd_vel.append(now, math.hypot(command.vx, command.vy), command.w)
                    self._numbers += 3
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

    @property
    def is_full(self) -> bool:
        """Whether no further messages may be added, which would need too much memory."""
        return self._numbers > _MOST_NUMBERS or len(self.records) >= _MOST_RECORDS

    @property
    def has_both(self) -> bool:
        """Whether the robot's states and commands to move are known."""
        return any(segment.odom and segment.cmd_vel for segment in self.segments)

    @property
    def has_goals(self) -> bool:
        """Whether there are goals of action servers."""
        return bool(self._goals.goals)

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
        if self._robot_in_tf and not states and self._parents:
            frames = ", ".join(printable(name) for name in self._transforms.frames[:8])
            yield (
                f"tf: expected {_ROBOT_FRAME}, or a single frame, in {_ODOMETRY_FRAME}; "
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
        goals = self._goals.goals.values()
        return self._accepted(
            "goals",
            ((goal.action, self._rejection(goal) or self._server_episode(goal)) for goal in goals),
        )

    def _rejection(self, goal: ServerGoal) -> str:
        """Return why a goal cannot be used; empty if it can."""
        reason = goal.rejection()
        if reason == NOT_CONNECTED:
            frames = ", ".join(printable(name) for name in self._transforms.frames[:8])
            odometry = printable(self._odometry.frame)
            return (
                f"tf: expected transforms from {printable(goal.frame)} to {odometry}, "
                f"got the frames {frames or 'none'}"
            )
        return reason

    def _server_episode(self, goal: ServerGoal) -> Episode | str:
        """Return the episode of a server's goal, in the goal's frame, or why it cannot be used."""
        segment = self.segments[goal.segment]
        robot = self._robot
        if segment is not self.segments[-1] and goal.end == segment.odom.last[0]:
            return "odometry was interrupted"
        if goal.end - goal.begin > _LONGEST:
            return _TOO_LONG
        top = next((top for top in self._domain.tops if top.action == goal.action), None)
        if top is None or goal.pose is None or goal.odom_pose is None:
            return "no TOP calls the action"
        track = segment.track.seen_from(goal.odom_pose)
        errors = (math.nan, math.nan)
        if goal.final_pose is not None:
            reached = (
                robot.hold_point(goal.final_pose) if top.point is Point.HOLD else goal.final_pose
            )
            errors = reached.distance(goal.pose), abs(wrap_angle(reached.yaw - goal.pose.yaw))
        if jump := track.jump(robot, goal.begin, goal.end):
            return jump
        start = track.world(goal.begin)
        situation = Situation(
            goal.action, start.robot, start.objects, Goal(goal.pose, 0.0, top.point)
        )
        episode = Episode(
            situation,
            round(goal.end - goal.begin, DIGITS),
            goal.status == "succeeded",
            f"recorded: its server reported {goal.status}",
            *errors,
            samples=track.samples(goal.begin, goal.end, start.objects),
        )
        too_far = fault_in(episode, top, robot)
        return "the goal is farther than the robot drives in its duration" if too_far else episode

    def _add_state(self, time: float, robot: RobotState) -> None:
        odom = self.segments[-1].odom
        last = odom.last[0] if odom else time
        if time < last and not self._is_older:
            self._is_older = True  # one late message is ignored, two in a row are a reset
            return
        self._is_older = False
        if odom and not 0.0 <= time - last <= SILENCE:
            self.segments.append(Segment())
            self._numbers += _SEGMENT
        self.segments[-1].odom.append(time, *robot.pose, robot.vx, robot.w, robot.vy)
        self._numbers += WIDTH

    def _add_transforms(self, message: Any, *, fixed: bool) -> None:
        for transform in message.transforms:
            parent, child, time, placement = transform_from(transform)
            self._check_frames(parent, child)
            self._transforms.add(parent, child, time, placement, fixed=fixed)
        if self._robot_in_tf and (
            found := self._transforms.latest(self._odometry.frame, self._robot_frame())
        ):
            self._add_state(*robot_from_placement(self._velocity, *found))
        for name, frame in self._in_tf.items():
            found = self._transforms.latest(self._odometry.frame, frame)
            rows = self.segments[-1].objects[name]
            if found is not None and not (rows and found[0] == rows.last[0]):
                self._add_object(name, *self._objects[name].read_placement(*found))

    def _check_frames(self, parent: str, child: str) -> None:
        """Note the parent of a frame in tf; raise MessageError for too many or long names."""
        if len(parent) > _LONGEST_NAME or len(child) > _LONGEST_NAME:
            raise MessageError(
                f"tf: expected names of at most {_LONGEST_NAME} characters, got {quoted(child)}"
            )
        if child not in self._parents and len(self._parents) >= _MOST_FRAMES:
            raise MessageError(f"tf: expected at most {_MOST_FRAMES} frames, got more")
        self._parents[child] = parent

    def _robot_frame(self) -> str:
        """Return the robot's frame in tf: base_link, else the only child of odometry's frame."""
        if _ROBOT_FRAME in self._parents:
            return _ROBOT_FRAME
        children = [
            child for child, parent in self._parents.items() if parent == self._odometry.frame
        ]
        return children[0] if len(children) == 1 else _ROBOT_FRAME

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
            unusable = _TOO_LONG if end - begin > _LONGEST else ""
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
