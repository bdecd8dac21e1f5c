"""Experience from recordings (MCAP, made by ``ros2 bag record -s mcap``): a real robot has no other.

The records that our executor publishes on ``performance/action`` are taken as they are. Where there are none,
drives are found in ``odom`` and ``cmd_vel``, and in the topics of the domain's objects; see `drives`.
"""

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from ator_ros.experience.columns import MOST_OBJECTS
from ator_ros.experience.drives import SHORTEST, drives
from ator_ros.experience.episode import Episode
from ator_ros.experience.errors import ExperienceError
from ator_ros.experience.records import ENDED, episode_of, finite, pose_of, sound
from ator_ros.experience.streams import Streams
from ator_ros.experience.table import Experience, episode_frame, join, library_versions
from ator_ros.experience.validation import checked_rows
from ator_ros.experience.vocabulary import Vocabulary
from ator_ros.files import limited_memory
from ator_ros.printable import printable
from ator_ros.robot.description import Robot

TOPICS = ("odom", "cmd_vel")
RECORDS = "performance/action"
_LARGEST_MESSAGE = 100_000  # bytes; ours have some hundred
_MOST_BYTES = 4_000_000_000  # of memory


class RecordingError(ExperienceError):
    """A recording that holds no experience; the message names it and says what was expected."""


@dataclass
class _Recorded:
    """What one robot recorded: stretches of its time, and the executor's records."""

    stretches: list[Streams] = field(default_factory=lambda: [Streams()])
    records: list[Episode] = field(default_factory=list)
    action_sets: set[str] = field(default_factory=set)
    left_out: int = 0

    def add(self, message: Any, domain: Vocabulary) -> None:
        """Take an ActionPerformance; one with numbers that are none is left out, and counted."""
        episode = episode_of(message, domain)
        if not sound(episode):
            self.left_out += 1
            return
        self.records.append(episode)
        # Recordings from before it was told have none.
        self.action_sets.add(getattr(message, "action_set", "") or "default")

    def episodes(self, robot: Robot, domain: Vocabulary) -> Iterator[Episode]:
        """Yield the executor's records, or the drives where there are none."""
        if self.records:
            yield from self.records
        else:
            for streams in self.stretches:
                yield from drives(streams, robot, domain)


def read_recording(path: Path | str, robot: Robot, domain: Vocabulary) -> Experience:
    """Read the drives of a recording as experience.

    Parameters
    ----------
    path : Path or str
        An .mcap file, or the folder that ``ros2 bag record`` made.
    robot : Robot
        The robot that was recorded.
    domain : Vocabulary
        Its objects have topics of their names; its TOPs say what drives and records are of.

    Raises
    ------
    RecordingError
        rosbags is not installed, or the recording is damaged, lacks a topic, holds no drive, or actions
        of several sets.
    ExperienceError
        It names an action or an action set by what is no name.
    """
    file = Path(path)
    by_robot = _read(file, domain)
    episodes = [episode for recorded in by_robot.values() for episode in recorded.episodes(robot, domain)]
    if not episodes:
        raise RecordingError(
            f"{file}: expected the topic {RECORDS}, or odom and cmd_vel with at least one drive of "
            f"{SHORTEST} s between two stops; found {_listed(by_robot) or 'no such topics'} without one"
        )
    objects = _objects(file, domain, episodes)
    numbers: dict[str, int] = defaultdict(int)
    frames: list[pd.DataFrame] = []
    for episode in episodes:
        action = episode.situation.action
        frames.append(episode_frame(numbers[action], episode, objects))
        numbers[action] += 1
    metadata = {
        "seed": None,
        "robot_digest": robot.digest(),
        "domain": domain.name,
        "action_set": _action_set(file, by_robot),
        "command": f"recording {file.name}",
        "records_left_out": sum(recorded.left_out for recorded in by_robot.values()),
        "versions": library_versions(),
    }
    rows = checked_rows(file, join(frames), metadata["action_set"] or "default")
    return Experience(rows, metadata)


def _objects(file: Path, domain: Vocabulary, episodes: Iterable[Episode]) -> tuple[str, ...]:
    """Return the objects of the domain, and those that records name besides."""
    found = tuple(dict.fromkeys([*domain.objects, *(name for item in episodes for name in item.objects)]))
    if len(found) > MOST_OBJECTS:
        raise RecordingError(f"{file}: expected at most {MOST_OBJECTS} objects, got {len(found)}")
    return found


def _action_set(file: Path, by_robot: Mapping[str, _Recorded]) -> str | None:
    """Return the action set that the records tell of; odometry and commands tell of none."""
    found = sorted(set().union(*(recorded.action_sets for recorded in by_robot.values())))
    if len(found) > 1:
        raise RecordingError(f"{file}: expected records of one action set, got {_listed(found)}")
    return found[0] if found else None


def _read(file: Path, domain: Vocabulary) -> dict[str, _Recorded]:
    """Return what was recorded by the namespace of the robot."""
    by_robot: dict[str, _Recorded] = defaultdict(_Recorded)
    topics = (RECORDS, *TOPICS, *domain.objects)
    for name, message in _messages(file, topics):
        topic = _kind(name, topics)
        namespace = name[: -len(topic)] or "/"
        if topic != RECORDS:
            _add(by_robot[namespace], topic, message)
        elif message.outcome.code in ENDED:
            by_robot[namespace].add(message, domain)
    return by_robot


def _messages(file: Path, topics: Sequence[str]) -> Iterator[tuple[str, Any]]:
    """Yield topic and message of all of `topics`, in the order of their arrival."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise RecordingError("recordings need the package rosbags: pip install rosbags") from error
    try:
        typestore = get_typestore(Stores.ROS2_JAZZY)
        with limited_memory(_MOST_BYTES), AnyReader([file], default_typestore=typestore) as reader:
            wanted = [c for c in reader.connections if _kind(c.topic, topics)]
            for connection, _, raw in reader.messages(connections=wanted):
                if len(raw) > _LARGEST_MESSAGE:
                    raise ValueError(f"a message of {len(raw)} bytes on {connection.topic}")
                yield connection.topic, reader.deserialize(raw, connection.msgtype)
    except Exception as error:  # a damaged file makes rosbags raise anything, MemoryError included
        why = "it needs too much memory" if isinstance(error, MemoryError) else printable(error, 200)
        raise RecordingError(f"{file}: expected a recording of ros2 bag record -s mcap: {why}") from error


def _listed(names: Iterable[str]) -> str:
    """Return the first of the names that a recording holds."""
    return ", ".join(map(printable, itertools.islice(names, 5)))


def _kind(topic: str, topics: Sequence[str]) -> str:
    """Return which of `topics` a topic is, in whatever namespace; empty for none."""
    return next((name for name in topics if f"/{topic}".endswith(f"/{name}")), "")


def _add(recorded: _Recorded, topic: str, message: Any) -> None:
    streams = recorded.stretches[-1]
    if topic == "cmd_vel":
        # A Twist has no stamp: it counts from the last odometry on, which is in the robot's own time.
        twist = getattr(message, "twist", message)
        now = streams.odom[-1][0] if streams.odom else math.nan
        command = (now, twist.linear.x, twist.angular.z)
        if finite(command):
            streams.cmd_vel.append(command)
        return
    stamp = message.header.stamp
    time = stamp.sec + 1e-9 * stamp.nanosec
    pose, twist = pose_of(message.pose.pose), message.twist.twist
    if topic not in TOPICS:
        if finite(pose):
            streams.objects[topic].append((time, pose.x, pose.y))
    elif finite(row := (time, *pose, twist.linear.x, twist.angular.z)):
        if not streams.goes_on_at(time):
            recorded.stretches.append(streams := Streams())
        streams.odom.append(row)
