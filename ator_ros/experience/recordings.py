"""Experience from recordings (``ros2 bag record``, MCAP or sqlite3), and from all sources of `train`.

Records of the executor on ``performance/action`` are episodes. Without records, the goals of the
domain's action servers are. Without both, drives are found in ``odom``, ``cmd_vel`` and the topics
of the domain's objects.
"""

from __future__ import annotations

import contextlib
import itertools
import sqlite3
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ator_ros.actions import DEFAULT_SET
from ator_ros.experience.drives import CMD_VEL, ODOM, RECORDS, SHORTEST, TF, Reader
from ator_ros.experience.records import Vocabulary
from ator_ros.experience.server_goals import GOAL_POSE, PLAN, status_topics
from ator_ros.experience.store import is_store, read_store
from ator_ros.experience.table import (
    Experience,
    ExperienceError,
    checked_rows,
    episode_frame,
    join,
    read_experience,
)
from ator_ros.printable import printable, quoted
from ator_ros.robot.description import Robot

Topic = tuple[str, str]
"""Name of a topic, and type of its messages as in nav_msgs/msg/Odometry."""
_TYPES = {
    ODOM: {"nav_msgs/msg/Odometry"},
    CMD_VEL: {"geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"},
    RECORDS: {"ator_interfaces/msg/ActionPerformance"},
    PLAN: {"nav_msgs/msg/Path"},
    GOAL_POSE: {"geometry_msgs/msg/PoseStamped"},
}


class _Wanted(NamedTuple):
    """A topic to read: its role, such as odometry.

    Its name, absolute or in any namespace; and its types.
    """

    role: str
    name: str
    types: Collection[str]


def _select(
    topics: Sequence[Topic], wanted: Sequence[_Wanted]
) -> tuple[defaultdict[Topic, list[str]], list[str]]:
    """Return the roles of the topics to read, and a line for each topic that is skipped.

    Records are read from every namespace. Of several other topics with one name, the one in the
    namespace of the odometry is read, by default the one without a namespace.
    """
    roles: defaultdict[Topic, list[str]] = defaultdict(list)
    skipped: list[str] = []
    namespace = "/"
    for role, name, types in wanted:  # the odometry first
        named = [
            (topic, kind) for topic, kind in topics if topic == name or topic.endswith(f"/{name}")
        ]
        found = [(topic, kind) for topic, kind in named if kind in types]
        skipped += [
            f"skipped {printable(topic)}: expected {' or '.join(sorted(types))}, got {printable(kind)}"
            for topic, kind in named
            if kind not in types
        ]
        if len(found) > 1 and role != RECORDS:
            near = [topic for topic in found if topic[0] == f"{namespace}{name}"]
            if not near:
                several = _listed(topic for topic, _ in found)
                skipped.append(f"skipped {several}: expected one of them as {role}")
            found = near
        if role == ODOM and found:
            namespace = found[0][0].rpartition("/")[0] + "/"
        for topic in found:
            roles[topic].append(role)
    return roles, skipped


class _Mcap:
    """An .mcap file: `topics` are those with messages, `begin` is the time of the first one."""

    def __init__(self, path: Path, stack: contextlib.ExitStack) -> None:
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory

        file = stack.enter_context(path.open("rb"))
        self._reader: Any = make_reader(file, decoder_factories=[DecoderFactory()])
        summary: Any = self._reader.get_summary()
        schemas = (
            (item.topic, summary.schemas.get(item.schema_id)) for item in summary.channels.values()
        )
        # Definitions of services and actions have another encoding.
        self.topics = {
            (topic, kind.name) for topic, kind in schemas if kind and kind.encoding == "ros2msg"
        }
        self.begin = summary.statistics.message_start_time

    def messages(self, topics: Collection[Topic]) -> Iterator[tuple[Topic, Any]]:
        """Yield the messages on some topics in the order of arrival."""
        names = [name for name, _ in topics]
        for schema, channel, _, message in self._reader.iter_decoded_messages(topics=names):
            if (channel.topic, schema.name) in topics:
                yield (channel.topic, schema.name), message


class _Sqlite:
    """A .db3 file, with the definitions that are in it since ROS 2 Iron."""

    def __init__(self, path: Path, stack: contextlib.ExitStack) -> None:
        database = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)
        self._data = stack.enter_context(contextlib.closing(database))
        texts = "SELECT topic_type, encoded_message_definition FROM message_definitions WHERE encoding = ?"
        self._definitions = dict(self._data.execute(texts, ("ros2msg",)).fetchall())
        rows = self._data.execute("SELECT name, type FROM topics").fetchall()
        self.topics = {(name, kind) for name, kind in rows if kind in self._definitions}
        self.begin = self._data.execute("SELECT min(timestamp) FROM messages").fetchone()[0] or 0

    def messages(self, topics: Collection[Topic]) -> Iterator[tuple[Topic, Any]]:
        """Yield the messages on some topics in the order of arrival."""
        from mcap.records import Schema
        from mcap_ros2.decoder import DecoderFactory

        decoders = {}
        for number, (topic, kind) in enumerate(topics, 1):
            schema = Schema(number, self._definitions[kind].encode(), "ros2msg", kind)
            decoders[topic, kind] = DecoderFactory().decoder_for("cdr", schema)
        query = "SELECT name, type, data FROM messages JOIN topics ON topic_id = topics.id ORDER BY timestamp"
        for name, kind, data in self._data.execute(query):
            if (decode := decoders.get((name, kind))) is not None:
                yield (name, kind), decode(data)


_FILES: dict[str, type[_Mcap | _Sqlite]] = {".mcap": _Mcap, ".db3": _Sqlite}


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[list[_Mcap | _Sqlite]]:
    """Yield the files of a recording, in the order of time."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    files = [file for file in files if file.suffix in _FILES]
    if not files or not all(file.is_file() for file in files):  # opening a pipe may block
        raise ValueError("expected .mcap or .db3 files, found none")
    with contextlib.ExitStack() as stack:
        yield sorted(
            (_FILES[file.suffix](file, stack) for file in files), key=lambda file: file.begin
        )


def read_recording(
    path: Path | str, robot: Robot, domain: Vocabulary, names: Mapping[str, str] | None = None
) -> Experience:
    """Read the drives of a recording as experience.

    Parameters
    ----------
    path : Path or str
        An .mcap or .db3 file, or the folder that ``ros2 bag record`` made.
    domain : Vocabulary
        Sources of the objects, and the TOPs of drives and records.
    names : mapping, optional
        Absolute names of the topics "odom" and "cmd_vel"; by default these names in any namespace.

    Raises
    ------
    ExperienceError
        The recording is damaged, lacks a topic, has no drive, or has actions of several sets.
    """
    file = Path(path)
    reader, skipped, topics = _read(file, domain, robot, names or {})
    episodes, remarks = reader.episodes(), skipped + reader.remarks()
    if not episodes:
        if wrong := reader.errors.get(RECORDS, ""):
            raise ExperienceError(
                f"{file}: {RECORDS}: expected a record that can be used, got none: {wrong}"
            )
        usable = [topic for topic, kind in topics if kind in _TYPES[ODOM] | _TYPES[CMD_VEL]]
        found = f"topics of these types: {_listed(usable)}; name them with --odom and --cmd-vel"
        found = found if usable else "there are no topics of these types"
        statuses = "".join(f"{name} with tf and {PLAN}, or " for name in status_topics(domain))
        expected = (
            f"expected the topic {RECORDS}, or {statuses}odom (Odometry) and cmd_vel (Twist or TwistStamped) "
            f"in one namespace, with a drive of at least {SHORTEST} s between two stops"
        )
        raise ExperienceError(f"{file}: {'; '.join([expected, found, *remarks[:3]])}")
    if len(reader.action_sets) > 1:
        got = _listed(sorted(reader.action_sets))
        raise ExperienceError(f"{file}: expected records of one action set, got {got}")
    objects = tuple(
        dict.fromkeys([*domain.objects, *(name for each in episodes for name in each.objects)])
    )
    numbers: dict[str, Iterator[int]] = defaultdict(itertools.count)
    frames = [
        episode_frame(next(numbers[each.situation.action]), each, objects) for each in episodes
    ]
    action_set = next(iter(reader.action_sets), None)  # odometry and commands name none
    rows = checked_rows(file, join(frames), action_set or DEFAULT_SET)
    metadata = {"robot_digest": robot.digest(), "domain": domain.name, "action_set": action_set}
    metadata["command"] = f"recording {file.name}"
    return Experience(rows, metadata, tuple(f"{file.name}: {remark}" for remark in remarks))


def _read(
    file: Path, domain: Vocabulary, robot: Robot, names: Mapping[str, str]
) -> tuple[Reader, list[str], list[Topic]]:
    """Return the messages, a line for each topic that was skipped, and all topics."""
    sources, servers = [domain.source(name) for name in domain.objects], status_topics(domain)
    roles = [ODOM, CMD_VEL, RECORDS, *((PLAN, GOAL_POSE) if servers else ())]
    wanted = [_Wanted(role, names.get(role, role), _TYPES[role]) for role in roles]
    for item in sources:
        package = "nav_msgs" if item.type == "Odometry" else "geometry_msgs"
        if item.type != "tf":
            wanted.append(_Wanted(item.name, item.topic_or_frame, {f"{package}/msg/{item.type}"}))
    wanted += [_Wanted(name, name, {"action_msgs/msg/GoalStatusArray"}) for name in servers]
    if servers or any(item.type == "tf" for item in sources):
        wanted += [_Wanted(role, f"/{role}", {"tf2_msgs/msg/TFMessage"}) for role in TF]
    try:
        with _opened(file) as files:
            topics = sorted(set().union(*(each.topics for each in files)))
            selected, skipped = _select(topics, wanted)
            has_odometry = any(ODOM in each for each in selected.values())
            reader = Reader(robot, domain, robot_in_tf=not has_odometry)
            for part in files if selected else ():
                for topic, message in part.messages(selected.keys() & part.topics):
                    for role in selected[topic]:
                        reader.add(role, message)
    except ImportError:  # a package is missing or broken; the recording may be fine
        raise
    except Exception as error:  # a damaged file raises anything
        expected = (
            "a recording of ros2 bag record (mcap recover repairs an .mcap file that was cut off)"
        )
        why = printable(str(error) or repr(error), 200)
        raise ExperienceError(f"{file}: expected {expected}: {why}") from error
    return reader, skipped, topics


def _listed(names: Iterable[str]) -> str:
    """Return the first names as text."""
    return ", ".join(map(printable, itertools.islice(names, 8)))


# All sources


def read_sources(
    paths: Sequence[Path],
    robot: Robot,
    domain: Vocabulary,
    action_set: str | None = None,
    topics: Mapping[str, str] | None = None,
) -> Experience:
    """Read and join all sources; the metadata are those of the first one.

    Parameters
    ----------
    paths : sequence of Path
        Tables (.parquet), recordings (.mcap, .db3, or their folder), and stores of the node
        `learning`.
    action_set : str, optional
        Action set of sources that do not name one; all others must name this one.
    topics : mapping, optional
        Topics of odometry and commands in recordings, see `read_recording`.

    Raises
    ------
    ExperienceError, FileError
        A source cannot be used, or they are of different robots, domains or action sets.
    """
    tables, frames, shift = [], [], 0
    for path in paths:
        if path.suffix == ".parquet":
            table = read_experience(path)
        elif is_store(path):
            table = read_store(path, action_set)
        elif path.suffix in _FILES or path.is_dir():
            table = read_recording(path, robot, domain, topics)
        else:
            raise ExperienceError(
                f"{path}: expected a table of collect (.parquet) or a recording (.mcap, .db3, or its folder)"
            )
        for name, expected, advice in (
            ("domain", domain.name, "name its domain with --domain"),
            (
                "robot_digest",
                robot.digest(),
                f"{robot.name} is another robot: set --robot, or collect again",
            ),
        ):
            if (got := table.metadata.get(name, expected)) != expected:
                raise ExperienceError(
                    f"{path}: metadata.{name}: expected {expected!r}, got {quoted(got)}: {advice}"
                )
        tables.append(table)
        frames.append(table.frame.assign(episode=table.frame["episode"] + shift))
        shift = int(frames[-1]["episode"].max()) + 1
    sets = {table.metadata.get("action_set") or action_set or DEFAULT_SET for table in tables}
    sets |= {action_set} if action_set else set()
    if len(sets) > 1:
        raise ExperienceError(
            f"expected experience of one action set, got {', '.join(sorted(sets))}"
        )
    metadata = {**tables[0].metadata, "domain": domain.name, "action_set": sets.pop()}
    return Experience(
        join(frames), metadata, tuple(remark for table in tables for remark in table.remarks)
    )
