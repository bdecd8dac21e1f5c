"""Experience from recordings (MCAP, made by ``ros2 bag record -s mcap``): a real robot has no other.

Goals of action servers are taken from the servers' own topics, where requests and results were recorded.
Other records that our executor publishes on ``performance/action`` are taken as they are. Where there is
neither, drives are found in ``odom``, ``cmd_vel``, and the topics of the domain's objects; see `drives`.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from ator_ros.actions import DEFAULT_SET
from ator_ros.experience.action_topics import ActionTopics, topics_of
from ator_ros.experience.bag_reading import RecordingError, messages
from ator_ros.experience.columns import MOST_OBJECTS
from ator_ros.experience.drives import SHORTEST, drives
from ator_ros.experience.episode import Episode
from ator_ros.experience.records import ENDED, episode_of, sound
from ator_ros.experience.streams import Stretches, Track, kind_of
from ator_ros.experience.table import Experience, episode_frame, join, library_versions
from ator_ros.experience.validation import checked_rows
from ator_ros.experience.vocabulary import Vocabulary
from ator_ros.printable import printable
from ator_ros.robot.description import Robot

TOPICS = ("odom", "cmd_vel")
RECORDS = "performance/action"


@dataclass
class _Recorded:
    """What one robot recorded: stretches of its time, and the executor's records."""

    actions: ActionTopics
    stretches: Stretches = field(default_factory=Stretches)
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
        # Older recordings have none.
        self.action_sets.add(getattr(message, "action_set", "") or DEFAULT_SET)

    def episodes(self, robot: Robot, domain: Vocabulary) -> list[Episode]:
        """Return the goals of action servers and the executor's other records, or the drives."""
        tracks = [Track(streams) if streams.odom else None for streams in self.stretches.all]
        driven = list(self.actions.episodes(tracks, robot, self.stretches.frame))
        self.left_out += self.actions.left_out
        told = {episode.situation.action for episode in driven}
        both = [*driven, *(record for record in self.records if record.situation.action not in told)]
        return both or [
            episode for streams in self.stretches.all for episode in drives(streams, robot, domain)
        ]


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
    rows = checked_rows(file, join(frames), metadata["action_set"] or DEFAULT_SET)
    return Experience(rows, metadata)


def _objects(file: Path, domain: Vocabulary, episodes: Iterable[Episode]) -> tuple[str, ...]:
    """Return the objects of the domain, and those that records name besides."""
    found = tuple(dict.fromkeys([*domain.objects, *(name for item in episodes for name in item.objects)]))
    if len(found) > MOST_OBJECTS:
        raise RecordingError(f"{file}: expected at most {MOST_OBJECTS} objects, got {len(found)}")
    return found


def _action_set(file: Path, by_robot: Mapping[str, _Recorded]) -> str | None:
    """Return the action set named in the records, or None; odometry and commands name none."""
    found = sorted(set().union(*(recorded.action_sets for recorded in by_robot.values())))
    if len(found) > 1:
        raise RecordingError(f"{file}: expected records of one action set, got {_listed(found)}")
    return found[0] if found else None


def _read(file: Path, domain: Vocabulary) -> dict[str, _Recorded]:
    """Return what was recorded by the namespace of the robot."""
    by_robot: dict[str, _Recorded] = defaultdict(lambda: _Recorded(ActionTopics(domain)))
    servers = topics_of(domain)
    topics = (RECORDS, *TOPICS, *domain.objects, *servers)
    kinds = {call.type for call in domain.remote_calls.values()}
    for name, message in messages(file, lambda topic: bool(kind_of(topic, topics)), kinds):
        topic = kind_of(name, topics)
        namespace = name[: -len(topic)] or "/"
        if topic in servers:
            _add_goal(_driver(by_robot, namespace), topic, message)
        elif topic != RECORDS:
            by_robot[namespace].stretches.take(topic, message)
        elif message.outcome.code in ENDED:
            by_robot[namespace].add(message, domain)
    return by_robot


def _driver(by_robot: Mapping[str, _Recorded], namespace: str) -> _Recorded | None:
    """Return whom a server of a namespace drives: the robot there, or the only one; None if there is none."""
    moving = {name: recorded for name, recorded in by_robot.items() if recorded.stretches.newest.odom}
    return moving.get(namespace, next(iter(moving.values())) if len(moving) == 1 else None)


def _add_goal(recorded: _Recorded | None, topic: str, message: Any) -> None:
    # As commands, goals count from the last odometry on, which is in the robot's own time.
    if recorded is None:
        return
    now = recorded.stretches.newest.odom[-1][0]
    try:
        recorded.actions.take(topic, message, now, len(recorded.stretches.all) - 1)
    except (AttributeError, TypeError, ValueError):  # the topic is no action server's
        recorded.left_out += 1


def _listed(names: Iterable[str]) -> str:
    """Return the first of the names that a recording holds."""
    return ", ".join(map(printable, itertools.islice(names, 5)))
