"""Experience from recordings (MCAP, made by ``ros2 bag record -s mcap``): all that a real robot has.

Records of the executor on ``performance/action`` are episodes. Without records, drives are found in ``odom``,
``cmd_vel`` and the topics of the domain's objects; see `drives`.
"""

from __future__ import annotations

import contextlib
import itertools
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import pandas as pd

from ator_ros.actions import DEFAULT_SET
from ator_ros.experience.columns import MOST_OBJECTS, ExperienceError
from ator_ros.experience.drives import CHAINS, CMD_VEL, ODOM, RECORDS, SHORTEST, TF, SegmentReader, drives
from ator_ros.experience.episode import Episode
from ator_ros.experience.records import ENDED, Vocabulary, episode_of
from ator_ros.experience.table import Experience, checked_rows, episode_frame, join, library_versions
from ator_ros.files import limited_memory
from ator_ros.printable import printable
from ator_ros.robot.description import Robot
from ator_ros.world.messages import MessageError, ObjectSource

ABSOLUTE = ""
"""The namespace of topics that are selected by absolute names."""


@dataclass(frozen=True, slots=True)
class TopicNames:
    """Names of the topics of one robot's odometry and commands.

    Attributes
    ----------
    odom, cmd_vel : str
        "odom" and "cmd_vel", in any namespace, or absolute names.
    """

    odom: str = "odom"
    cmd_vel: str = "cmd_vel"

    def of(self, role: str) -> str:
        """Return the name of the topic of odom or cmd_vel."""
        name: str = getattr(self, role)
        return name


USUAL = TopicNames()


@dataclass(frozen=True, slots=True)
class Wanted:
    """A topic that is read.

    Attributes
    ----------
    role : str
        What it is read as: odometry, commands, an object.
    name : str
        Absolute, or relative to the namespace of a robot.
    types : collection of str
        Types of its messages, as nav_msgs/msg/Odometry.
    """

    role: str
    name: str
    types: Collection[str]

    def namespace(self, topic: str) -> str | None:
        """Return the namespace in which a topic has this name, or `ABSOLUTE`; None: it has another name."""
        if self.name.startswith("/"):
            return ABSOLUTE if topic == self.name else None
        return topic.removesuffix(self.name) if topic.endswith(f"/{self.name}") else None


@dataclass
class Selection:
    """Which topics of a recording are read.

    Attributes
    ----------
    topics : sequence of (str, str)
        All topics of the recording with their types.
    routes : dict of (str, str) to list of (str, str)
        Robots, by their namespaces, and roles that each topic is read for.
    robots : list of str
        The robots.
    skipped : list of str
        A line for each topic that has a wanted name but another type.
    """

    topics: Sequence[tuple[str, str]]
    routes: dict[tuple[str, str], list[tuple[str, str]]] = field(default_factory=lambda: defaultdict(list))
    robots: list[str] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)


def objects_wanted(sources: Iterable[ObjectSource]) -> list[Wanted]:
    """Return the topics of objects; for objects of tf, those of tf."""
    sources = list(sources)
    packages = {"Odometry": "nav_msgs"}
    wanted = [
        Wanted(item.name, item.listened, {f"{packages.get(item.type, 'geometry_msgs')}/msg/{item.type}"})
        for item in sources
        if item.type != "tf"
    ]
    if len(wanted) < len(sources):
        wanted += [Wanted(role, f"/{role}", {"tf2_msgs/msg/TFMessage"}) for role in TF]
    return wanted


def select(
    topics: Sequence[tuple[str, str]], wanted: Sequence[Wanted], names: TopicNames = USUAL
) -> Selection:
    """Select topics by name and type.

    A robot reads the topics in its namespace. Objects, action servers and records that are in another
    namespace belong to the only robot with odometry.

    Parameters
    ----------
    topics : sequence of (str, str)
        Names and types of the topics of a recording.
    wanted : sequence of Wanted
        What is read, odometry and commands by `names`.
    names : TopicNames, optional
        Unless they are the usual ones, all topics are one robot's, in whatever namespaces.
    """
    selection = Selection(topics)
    found: dict[str, dict[str, list[tuple[str, str]]]] = defaultdict(lambda: defaultdict(list))
    for topic, kind in topics:
        for item in wanted:
            space = item.namespace(topic if topic.startswith("/") else f"/{topic}")
            if space is None:
                continue
            if kind in item.types:
                found[item.role][space].append((topic, kind))
            else:
                expected = " or ".join(sorted(item.types))
                selection.skipped.append(
                    f"skipped {printable(topic)}: expected {expected}, got {printable(kind)}"
                )
    named = names != USUAL
    home = names.odom.rpartition("/")[0] + "/"
    spaces = sorted({*found[ODOM], *found[RECORDS], *found[CHAINS]})
    selection.robots = [home] if named else spaces

    def shares(robot: str, role: str) -> bool:
        """Return whether a robot without a topic of this role in its namespace reads one of another."""
        if named:
            return True
        drives = robot in found[ODOM] and len(found[ODOM]) == 1
        return drives and role not in (ODOM, CMD_VEL)

    for role, there in found.items():
        for robot in selection.robots:
            read = {ABSOLUTE, robot} & set(there)
            if not read and shares(robot, role):
                outer = [space for space in there if robot.startswith(space)]
                read = {max(outer, key=len)} if outer else set(there)
            if len(read - {ABSOLUTE}) > 1:
                listed = ", ".join(printable(link[0]) for space in sorted(there) for link in there[space])
                selection.skipped.append(f"skipped {listed}: expected one of them as {role}")
                continue
            for link in (link for space in read for link in there[space]):
                selection.routes[link].append((robot, role))
    return selection


_LARGEST_MESSAGE = 100_000  # bytes; odometry and records have about a thousand
_MOST_BYTES = 4_000_000_000  # of memory


class RecordingError(ExperienceError):
    """A recording without experience; the message names it and says what was expected."""


class Recording:
    """A recording that is open for reading, as a context manager.

    Parameters
    ----------
    file : Path
        An .mcap file, or the folder that ``ros2 bag record`` made.

    Attributes
    ----------
    topics : list of (str, str)
        Name and type of each topic, in the order of their names; a topic may have several types.

    Raises
    ------
    RecordingError
        rosbags is not installed, or the recording is damaged.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._stack = contextlib.ExitStack()
        self.topics: list[tuple[str, str]] = []

    def __enter__(self) -> Self:
        """Open the file."""
        try:
            from rosbags.highlevel import AnyReader
            from rosbags.typesys import Stores, get_typestore
        except ImportError as error:
            raise RecordingError("recordings need the package rosbags: pip install rosbags") from error
        with _reading(self._file), contextlib.ExitStack() as stack:
            _refuse_pipes(self._file)
            usual = get_typestore(Stores.ROS2_JAZZY)
            with _only_messages_defined():
                self._reader = stack.enter_context(AnyReader([self._file], default_typestore=usual))
            self.topics = sorted({(link.topic, link.msgtype) for link in self._reader.connections})
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self._stack.close()

    def messages(self, topics: Collection[tuple[str, str]]) -> Iterator[tuple[str, str, Any]]:
        """Yield topic, type and message of some of `topics` in the order of arrival.

        Types that neither the recording nor this installation defines are left out.
        """
        store = self._reader.typestore
        with _reading(self._file), limited_memory(_MOST_BYTES):
            links = [link for link in self._reader.connections if (link.topic, link.msgtype) in topics]
            readable = [link for link in links if link.msgtype in store.fielddefs]
            for link, _, raw in self._reader.messages(connections=readable) if readable else ():
                if len(raw) > _LARGEST_MESSAGE:
                    raise ValueError(f"a message of {len(raw)} bytes on {link.topic}")
                yield link.topic, link.msgtype, self._reader.deserialize(raw, link.msgtype)


@contextlib.contextmanager
def _reading(file: Path) -> Iterator[None]:
    """Raise RecordingError for whatever rosbags raises about a damaged file, MemoryError included."""
    try:
        yield
    except Exception as error:
        why = "it needs too much memory" if isinstance(error, MemoryError) else printable(error, 200)
        raise RecordingError(f"{file}: expected a recording of ros2 bag record -s mcap: {why}") from error


def _refuse_pipes(file: Path) -> None:
    """Raise ValueError where a recording has a pipe or a device: opening one may wait for ever."""
    for part in (file, *(file.iterdir() if file.is_dir() else ())):
        if part.exists() and not (part.is_file() or part.is_dir()):
            raise ValueError(f"{part.name} is a pipe or a device")


@contextlib.contextmanager
def _only_messages_defined() -> Iterator[None]:
    """Let rosbags skip the definitions of types that are no messages.

    Recorders leave the definitions of services and actions empty, in an encoding that rosbags does not know,
    or put a whole .srv or .action file there. Either makes rosbags refuse the whole recording.
    """
    from rosbags.rosbag2 import storage_mcap

    original: Any = getattr(storage_mcap, "get_msgdef", None)
    if original is None:
        yield
        return

    def tolerant(schema: Any) -> Any:
        no_message = schema is not None and ("/action/" in schema.name or "/srv/" in schema.name)
        return original(None if no_message else schema)

    storage_mcap.get_msgdef = tolerant
    try:
        yield
    finally:
        storage_mcap.get_msgdef = original


TYPES = {
    ODOM: {"nav_msgs/msg/Odometry"},
    CMD_VEL: {"geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"},
}


@dataclass
class _Recorded:
    """The messages of one robot: segments of odometry and commands, and the executor's records."""

    reader: SegmentReader
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
        else:
            self.reader.take(role, message)

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
        """Return doubts, and a line for each role of which messages were left out."""
        there = self.left_out + len(self.records)
        records = [f"left out {self.left_out} of {there} records: {self.wrong}"] if self.left_out else []
        return [*self.reader.remarks, *self.reader.timing(), *self.reader.left_out(), *records]

    def episodes(self, robot: Robot, domain: Vocabulary) -> list[Episode]:
        """Return the executor's records or, without any, the drives."""
        return self.records or [
            episode for segment in self.reader.segments for episode in drives(segment, robot, domain)
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
        The recorded robot.
    domain : Vocabulary
        Sources of the objects, and the TOPs of drives and records.
    names : TopicNames, optional
        The topics of odometry and commands.

    Raises
    ------
    RecordingError
        rosbags is not installed, or the recording is damaged, lacks a topic, has no drive, or has actions
        of several sets.
    ExperienceError
        The name of an action or an action set is invalid.
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
        "records_left_out": sum(each.left_out for each in by_robot.values()),
        "versions": library_versions(),
    }
    rows = checked_rows(file, join(frames), metadata["action_set"] or DEFAULT_SET)
    return Experience(rows, metadata, tuple(f"{file.name}: {remark}" for remark in remarks))


def _nothing(by_robot: Mapping[str, _Recorded], selection: Selection, remarks: Sequence[str]) -> str:
    """Return why a recording has no episode, and what can be done."""
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
    there = [topic for topic, kind in selection.topics if kind in TYPES[ODOM] | TYPES[CMD_VEL]]
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
    """Return the objects of the domain, and others that records name."""
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
    """Return the messages by namespace of the robot, and the topics that were read."""
    sources = [domain.source(name) for name in domain.objects]
    wanted = [
        *(Wanted(role, names.of(role), TYPES[role]) for role in (ODOM, CMD_VEL)),
        Wanted(RECORDS, RECORDS, {"ator_interfaces/msg/ActionPerformance"}),
        *objects_wanted(sources),
    ]
    with Recording(file) as recording:
        selection = select(recording.topics, wanted, names)
        by_robot = {space: _Recorded(SegmentReader(sources)) for space in selection.robots}
        for topic, kind, message in recording.messages(selection.routes.keys()):
            for space, role in selection.routes[topic, kind]:
                by_robot[space].take(role, message, domain, robot)
    return by_robot, selection


def _listed(names: Iterable[str]) -> str:
    """Return the first names as text."""
    return ", ".join(map(printable, itertools.islice(names, 8)))
