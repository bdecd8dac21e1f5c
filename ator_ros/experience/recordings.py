"""Experience from recordings (MCAP, made by ``ros2 bag record -s mcap``): a real robot has no other.

Goals of action servers are taken from the servers' own topics, where requests and results were recorded.
Other records that our executor publishes on ``performance/action`` are taken as they are. Where there is
neither, drives are found in ``odom``, ``cmd_vel``, and the topics of the domain's objects; see `drives`.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from ator_ros.actions import DEFAULT_SET
from ator_ros.experience.action_topics import ActionTopics, topics_of
from ator_ros.experience.bag_reading import Recording, RecordingError
from ator_ros.experience.columns import MOST_OBJECTS
from ator_ros.experience.drives import SHORTEST, drives
from ator_ros.experience.episode import Episode
from ator_ros.experience.records import ENDED, episode_of
from ator_ros.experience.streams import Stretches, Track
from ator_ros.experience.table import Experience, episode_frame, join, library_versions
from ator_ros.experience.topics import (
    CMD_VEL,
    ODOM,
    RECORDS,
    USUAL,
    Selection,
    TopicNames,
    Wanted,
    objects_wanted,
    select,
)
from ator_ros.experience.validation import checked_rows
from ator_ros.experience.vocabulary import Vocabulary
from ator_ros.printable import printable
from ator_ros.robot.description import Robot
from ator_ros.world.messages import MessageError

TYPES = {
    ODOM: {"nav_msgs/msg/Odometry"},
    CMD_VEL: {"geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"},
}


@dataclass
class _Recorded:
    """What one robot recorded: stretches of its time, and the executor's records."""

    actions: ActionTopics
    stretches: Stretches
    records: list[Episode] = field(default_factory=list)
    action_sets: set[str] = field(default_factory=set)
    left_out: int = 0
    wrong: str = ""
    """Why the first record was left out."""

    def take(self, role: str, message: Any, domain: Vocabulary, robot: Robot) -> None:
        """Take a message of a topic that was selected as `role`."""
        if role == RECORDS:
            if message.outcome.code in ENDED:
                self._add_record(message, domain, robot)
        elif "/_action/" in role:
            self._add_goal(role, message)
        else:
            self.stretches.take(role, message)

    def _add_record(self, message: Any, domain: Vocabulary, robot: Robot) -> None:
        """Take an ActionPerformance; one that cannot be used is left out, and counted."""
        try:
            episode = episode_of(message, domain, robot)
        except MessageError as error:
            self.left_out += 1
            self.wrong = self.wrong or str(error)
            return
        self.records.append(episode)
        # Older recordings have none.
        self.action_sets.add(getattr(message, "action_set", "") or DEFAULT_SET)

    def remarks(self) -> list[str]:
        """Return what is doubtful, and a line for each kind of what was left out."""
        there = self.left_out + len(self.records)
        records = [f"left out {self.left_out} of {there} records: {self.wrong}"] if self.left_out else []
        goals = self.actions.left_out_lines()
        track = [*self.stretches.remarks, *self.stretches.timing(), *self.stretches.left_out()]
        return [*track, *records, *goals]

    def _add_goal(self, role: str, message: Any) -> None:
        # As commands, goals count from the last odometry on, which is in the robot's own time.
        odom = self.stretches.newest.odom
        if odom:
            self.actions.take(role, message, odom.last_time, len(self.stretches.all) - 1)

    def episodes(self, robot: Robot, domain: Vocabulary) -> list[Episode]:
        """Return the goals of action servers and the executor's other records, or the drives."""
        tracks = [Track(streams) if streams.odom else None for streams in self.stretches.all]
        driven = list(self.actions.episodes(tracks, robot, self.stretches.frame))
        told = {episode.situation.action for episode in driven}
        both = [*driven, *(record for record in self.records if record.situation.action not in told)]
        return both or [
            episode for streams in self.stretches.all for episode in drives(streams, robot, domain)
        ]


def read_recording(
    path: Path | str, robot: Robot, domain: Vocabulary, names: TopicNames = USUAL
) -> Experience:
    """Read the drives of a recording as experience.

    Parameters
    ----------
    path : Path or str
        An .mcap file, or the folder that ``ros2 bag record`` made.
    robot : Robot
        The robot that was recorded.
    domain : Vocabulary
        Says where its objects come from; its TOPs say what drives and records are of.
    names : TopicNames, optional
        The topics of odometry and commands.

    Raises
    ------
    RecordingError
        rosbags is not installed, or the recording is damaged, lacks a topic, holds no drive, or actions
        of several sets.
    ExperienceError
        It names an action or an action set by what is no name.
    """
    file = Path(path)
    by_robot, selection = _read(file, domain, robot, names)
    episodes = [episode for recorded in by_robot.values() for episode in recorded.episodes(robot, domain)]
    remarks = list(selection.skipped)
    for recorded in by_robot.values():
        remarks += recorded.remarks()
    if not episodes:
        raise RecordingError(f"{file}: {_nothing(by_robot, selection, remarks)}")
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
        "records_left_out": sum(each.left_out + each.actions.left_out for each in by_robot.values()),
        "versions": library_versions(),
    }
    rows = checked_rows(file, join(frames), metadata["action_set"] or DEFAULT_SET)
    return Experience(rows, metadata, tuple(f"{file.name}: {remark}" for remark in remarks))


def _nothing(by_robot: Mapping[str, _Recorded], selection: Selection, remarks: Sequence[str]) -> str:
    """Return why a recording holds no episode, and what can be done."""
    wrong = [recorded.wrong for recorded in by_robot.values() if recorded.wrong]
    if wrong:
        return f"{RECORDS}: expected a record that can be used, got none: {wrong[0]}"
    routed = [
        {role for places in selection.routes.values() for space, role in places if space == robot}
        for robot in by_robot
    ]
    if any(roles >= {ODOM, CMD_VEL} for roles in routed):
        topics = _listed(topic for topic, _ in selection.routes)
        expected = f"expected at least one drive of {SHORTEST} s between two stops on {topics}, found none"
        return "; ".join([expected, *remarks[:3]])
    there = selection.of_types([*TYPES[ODOM], *TYPES[CMD_VEL]])
    found = f"topics of these types: {_listed(there)}" if there else "there are no topics of these types"
    advice = "; name them with --odom and --cmd-vel" if there else ""
    return "; ".join(
        [
            f"expected the topic {RECORDS}, or odom (Odometry) and cmd_vel (Twist or TwistStamped) in one "
            f"namespace; {found}{advice}",
            *remarks[:3],
        ]
    )


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


def _read(
    file: Path, domain: Vocabulary, robot: Robot, names: TopicNames
) -> tuple[dict[str, _Recorded], Selection]:
    """Return what was recorded by the namespace of the robot, and which topics were read."""
    sources = [domain.source(name) for name in domain.objects]
    wanted = [
        *(Wanted(role, names.of(role), TYPES[role]) for role in (ODOM, CMD_VEL)),
        Wanted(RECORDS, RECORDS, {"ator_interfaces/msg/ActionPerformance"}),
        *(Wanted(topic, topic, types) for topic, types in topics_of(domain).items()),
        *objects_wanted(sources),
    ]
    kinds = {call.type for call in domain.remote_calls.values()}
    with Recording(file, kinds) as recording:
        selection = select(recording.topics, wanted, names)
        by_robot = {space: _Recorded(ActionTopics(domain), Stretches(sources)) for space in selection.robots}
        for topic, kind, message in recording.messages(selection.routes.keys()):
            for space, role in selection.routes[topic, kind]:
                by_robot[space].take(role, message, domain, robot)
    return by_robot, selection


def _listed(names: Iterable[str]) -> str:
    """Return the first of the names that a recording holds."""
    return ", ".join(map(printable, itertools.islice(names, 8)))
