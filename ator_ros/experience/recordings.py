"""Experience from recordings (``ros2 bag record``), and from all sources of `train`.

Records of the executor on ``performance/action`` are episodes. Without records, the goals of the
domain's action servers are. Without both, drives are found in ``odom``, ``cmd_vel`` and the topics
of the domain's objects.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pandas as pd

from ator_ros.actions import DEFAULT_SET
from ator_ros.actions.goal_variables import STOP, direct_name
from ator_ros.bases.description import Robot
from ator_ros.experience.drives import CMD_VEL, RECORDS, SHORTEST, Reader
from ator_ros.experience.records import Vocabulary, passing_actions
from ator_ros.experience.repeats import without_repeats
from ator_ros.experience.server_drives import ODOM, TF
from ator_ros.experience.server_goals import (
    FEEDBACK_SUFFIX,
    GOAL_POSE,
    PLAN,
    STATUS_SUFFIX,
    remote_calls,
    through_servers,
)
from ator_ros.experience.store import is_store, read_store
from ator_ros.experience.table import (
    Experience,
    ExperienceError,
    checked_rows,
    count_episodes,
    join,
    read_experience,
)
from ator_ros.printable import printable, quoted

if TYPE_CHECKING:
    from ator_ros.experience.bag_files import Topic

_TYPES = {
    ODOM: {"nav_msgs/msg/Odometry"},
    CMD_VEL: {"geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"},
    RECORDS: {"ator_interfaces/msg/ActionPerformance"},
    PLAN: {"nav_msgs/msg/Path"},
    GOAL_POSE: {"geometry_msgs/msg/PoseStamped"},
}
_STATUS = {"action_msgs/msg/GoalStatusArray"}

_RECORDED = (".mcap", ".db3")
_COMPRESSED = (".zstd", ".zst")
"""Suffixes of files that were compressed as a whole."""
_BATCH = 200  # episodes of which one table is made
_MOST_LINES = 8  # about topics that were skipped


def is_recording(path: Path) -> bool:
    """Return whether the name of a file is that of a recording."""
    name = path.stem if path.suffix in _COMPRESSED else path.name
    return name.endswith(_RECORDED)


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
    namespace of the odometry is read, or of the action without odometry; by default the one without
    a namespace.
    """
    roles: defaultdict[Topic, list[str]] = defaultdict(list)
    skipped: list[str] = []
    namespace: str | None = None  # unknown: that of the root
    for role, name, types in wanted:  # odometry first, then actions
        found = []
        for topic, kind in topics:
            if topic != name and not topic.endswith(f"/{name}"):
                continue
            if kind in types:
                found.append((topic, kind))
                continue
            expected = " or ".join(sorted(types))
            skipped.append(
                f"skipped {printable(topic)}: expected {expected}, got {printable(kind)}"
            )
        if len(found) > 1 and role != RECORDS:
            near = [topic for topic in found if topic[0] == f"{namespace or '/'}{name}"]
            if role in TF and not near:
                near = [topic for topic in found if topic[0] == f"/{name}"]
            if not near:
                several = _listed(topic for topic, _ in found)
                skipped.append(f"skipped {several}: expected one of them as {role}")
            found = near
        if found and namespace is None and (role == ODOM or types == _STATUS):
            namespace = _namespace(found[0][0], name)
        for each in found:
            roles[each].append(role)
    return roles, skipped


def _namespace(topic: str, name: str) -> str:
    """Return the namespace in which a topic has this name; absolute names say it themselves."""
    if name.startswith("/"):
        return name.removesuffix(STATUS_SUFFIX).rpartition("/")[0] + "/"
    return topic.removesuffix(name)


def read_recording(
    path: Path | str | Sequence[Path],
    robot: Robot,
    domain: Vocabulary,
    names: Mapping[str, str] | None = None,
) -> Experience:
    """Read the drives of a recording as experience.

    Parameters
    ----------
    path : Path, str or sequence of Path
        An .mcap or .db3 file, which may be compressed with zstd, or the folder that ``ros2 bag
        record`` made; several are read as one recording, in the order of time.
    domain : Vocabulary
        Sources of the objects, and the TOPs of drives and records.
    names : mapping, optional
        Absolute names of the topics "odom" and "cmd_vel"; by default these names in any namespace.

    Raises
    ------
    NoDrivesError
        The recording lacks a topic, or has no drive.
    ExperienceError
        It is damaged, or has actions of several sets.
    """
    paths = [Path(path)] if isinstance(path, Path | str) else list(path)
    place = " and ".join(str(each) for each in paths)
    reader, skipped, topics = _read(paths, place, domain, robot, names or {})
    episodes = reader.episodes()
    remarks = skipped + reader.remarks()
    if not episodes:
        if wrong := reader.errors.get(RECORDS, ""):
            raise ExperienceError(
                f"{place}: {RECORDS}: expected a record that can be used, got none: {wrong}"
            )
        raise NoDrivesError(f"{place}: {_without_drives(reader, topics, remarks, domain)}")
    if len(reader.action_sets) > 1:
        got = _listed(sorted(reader.action_sets))
        raise ExperienceError(f"{place}: expected records of one action set, got {got}")
    objects = tuple(
        dict.fromkeys(
            [*domain.objects, *(name for each in episodes for name in each.situation.objects)]
        )
    )
    numbers: dict[str, Iterator[int]] = defaultdict(itertools.count)
    frames = [
        join(
            each.rows(next(numbers[each.situation.action]), objects)
            for each in episodes[begin : begin + _BATCH]
        )
        for begin in range(0, len(episodes), _BATCH)
    ]
    action_set = next(iter(reader.action_sets), None)  # odometry and commands name none
    rows = checked_rows(place, join(frames), action_set or DEFAULT_SET)
    metadata = {"robot_digest": robot.digest(), "domain": domain.name, "action_set": action_set}
    title = " ".join(each.name for each in paths)
    metadata["command"] = f"recording {title}"
    return Experience(rows, metadata, tuple(f"{title}: {remark}" for remark in remarks))


class NoDrivesError(ExperienceError):
    """A recording has no drive; another recording may have what it lacks."""


def _without_drives(
    reader: Reader, topics: Iterable[Topic], remarks: Sequence[str], domain: Vocabulary
) -> str:
    """Return why a recording has no drives, as far as that is known."""
    if reader.has_goals:
        return "; ".join(["expected goals that are drives, found none", *remarks[:2]])
    if reader.has_both:
        expected = f"expected a drive of at least {SHORTEST} s between two stops of {CMD_VEL}"
        return "; ".join([f"{expected}, found none", *remarks[:2]])
    has_commands = any(kind in _TYPES[CMD_VEL] for _, kind in topics)
    has_states = any(segment.odom for segment in reader.segments)
    if has_commands and reader.left_out[ODOM] and not has_states:
        return "; ".join(["expected odometry that can be used, found none", *remarks[:3]])
    if remarks and any(kind in _TYPES[RECORDS] for _, kind in topics):
        return "; ".join(
            [f"{RECORDS}: expected records that can be used, found none", *remarks[:3]]
        )
    usable = [topic for topic, kind in topics if kind in _TYPES[ODOM] | _TYPES[CMD_VEL]]
    statuses = "".join(
        f"{call.server}{STATUS_SUFFIX} with tf and {PLAN}, or "
        for call in remote_calls(domain).values()
    )
    expected = (
        f"expected the topic {RECORDS}, or {statuses}odom (Odometry) and cmd_vel "
        "(Twist or TwistStamped) in one namespace"
    )
    found = f"topics of these types: {_listed(usable)}; name them with --odom and --cmd-vel"
    found = found if usable else "there are no topics of these types"
    return "; ".join([expected, found, *remarks[:3]])


def _read(
    paths: Sequence[Path],
    place: str,
    domain: Vocabulary,
    robot: Robot,
    names: Mapping[str, str],
) -> tuple[Reader, list[str], list[Topic]]:
    """Return the messages, a line for each topic or part that was skipped, and all topics."""
    try:
        from ator_ros.experience.bag_files import Bag  # packages that only recordings need

        files = [file for path in paths for file in _files_of(path)]
        with Bag(files) as bag:
            selected, skipped = _select(bag.topics, _wanted(domain, names))
            has_odometry = any(ODOM in each for each in selected.values())
            reader = Reader(robot, domain, robot_in_tf=not has_odometry)
            for topic, message in bag.messages(selected.keys()) if selected else ():
                for role in selected[topic]:
                    reader.add(role, message)
                if reader.is_full:
                    break
            if len(skipped) > _MOST_LINES:
                skipped[_MOST_LINES:] = [f"skipped {len(skipped) - _MOST_LINES} further topics"]
            return reader, skipped + bag.remarks(), bag.topics
    except ImportError:  # a package is missing or broken; the recording may be fine
        raise
    except Exception as error:  # a damaged file raises anything
        why = printable(str(error) or repr(error), 200)
        raise ExperienceError(f"{place}: expected a recording of ros2 bag record: {why}") from error


def _files_of(path: Path) -> list[Path]:
    """Return the files of a recording."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    files = [file for file in files if is_recording(file)]
    if not files or not all(file.is_file() for file in files):  # opening a pipe may block
        raise ValueError("expected .mcap or .db3 files, found none")
    return files


def _wanted(domain: Vocabulary, names: Mapping[str, str]) -> list[_Wanted]:
    """Return the topics to read, those first whose namespace decides."""
    sources = [domain.source(name) for name in domain.objects]
    servers = {call.server: call.type for call in remote_calls(domain).values()}
    servers |= {name: kind for name, (_, kind) in through_servers(domain).items()}
    wanted = [_Wanted(ODOM, names.get(ODOM, ODOM), _TYPES[ODOM])]
    for suffix in (STATUS_SUFFIX, FEEDBACK_SUFFIX):
        for name, kind in servers.items():
            kinds = _STATUS if suffix == STATUS_SUFFIX else {f"{kind}_FeedbackMessage"}
            wanted.append(_Wanted(f"{name}{suffix}", f"{name}{suffix}", kinds))
    roles = (CMD_VEL, RECORDS, *((PLAN, GOAL_POSE) if servers else ()))
    wanted += [_Wanted(role, names.get(role, role), _TYPES[role]) for role in roles]
    for item in sources:
        package = "nav_msgs" if item.type == "Odometry" else "geometry_msgs"
        if item.type != "tf":
            wanted.append(_Wanted(item.name, item.topic_or_frame, {f"{package}/msg/{item.type}"}))
    if servers or any(item.type == "tf" for item in sources):
        wanted += [_Wanted(role, role, {"tf2_msgs/msg/TFMessage"}) for role in TF]
    return wanted


def _listed(names: Iterable[str]) -> str:
    """Return the first names as text."""
    return ", ".join(map(printable, itertools.islice(names, 8)))


# All sources


def _with_stops(frame: pd.DataFrame, can_pass: frozenset[str]) -> pd.DataFrame:
    """Return rows in which the episodes of actions that can pass have stopped, if it is unknown.

    Recordings of goals of a server do not say it, nor does experience of before it could pass.
    """
    if not can_pass:
        return frame
    name = direct_name(STOP)
    stops = frame[name] if name in frame else pd.Series(np.nan, frame.index)
    unknown = stops.isna() & frame["action"].isin(can_pass)
    return frame.assign(**{name: stops.mask(unknown, 1.0)})


def read_sources(
    paths: Sequence[Path],
    robot: Robot,
    domain: Vocabulary,
    action_set: str | None = None,
    topics: Mapping[str, str] | None = None,
) -> Experience:
    """Read and join all sources; metadata are those of the first. Equal episodes count once.

    Parameters
    ----------
    paths : sequence of Path
        Tables (.parquet), recordings (.mcap, .db3, or their folder), and stores of the node
        `learning`. Recordings without drives are read together: one may have the odometry and
        another the commands.
    action_set : str, optional
        Action set of sources that do not name one; all others must name this one.
    topics : mapping, optional
        Topics of odometry and commands in recordings, see `read_recording`.

    Raises
    ------
    ExperienceError, FileError
        A source cannot be used, or they are of different robots, domains or action sets.
    """
    tables = []
    frames = []
    shift = 0
    for path, table in _tables(paths, robot, domain, action_set, topics):
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
        used = table.metadata.get("action_set") or action_set or DEFAULT_SET
        frame = _with_stops(table.frame, passing_actions(domain, used))
        frames.append(frame.assign(episode=frame["episode"] + shift))
        shift = int(frames[-1]["episode"].max()) + 1
    sets = {table.metadata.get("action_set") or action_set or DEFAULT_SET for table in tables}
    sets |= {action_set} if action_set else set()
    if len(sets) > 1:
        raise ExperienceError(
            f"expected experience of one action set, got {', '.join(sorted(sets))}"
        )
    metadata = {**tables[0].metadata, "domain": domain.name, "action_set": sets.pop()}
    rows = join(frames)
    once = without_repeats(rows)
    remarks = [remark for table in tables for remark in table.remarks]
    if repeats := count_episodes(rows) - count_episodes(once):
        remarks.append(f"{repeats} of {count_episodes(rows)} episodes are repeated and count once")
    return Experience(once, metadata, tuple(remarks))


def _tables(
    paths: Sequence[Path],
    robot: Robot,
    domain: Vocabulary,
    action_set: str | None,
    topics: Mapping[str, str] | None,
) -> Iterator[tuple[Path, Experience]]:
    """Yield each source as a table, and those recordings as one that have no drives alone."""
    parts: dict[Path, NoDrivesError] = {}
    for path in paths:
        if path.suffix == ".parquet":
            yield path, read_experience(path)
        elif is_store(path):
            yield path, read_store(path, action_set)
        elif is_recording(path) or path.is_dir():
            try:
                table = read_recording(path, robot, domain, topics)
            except NoDrivesError as error:
                parts[path] = error
            else:
                yield path, table
        else:
            raise ExperienceError(
                f"{path}: expected a table of collect (.parquet) or a recording "
                "(.mcap, .db3, or its folder)"
            )
    if len(parts) == 1:
        raise parts.popitem()[1]
    if parts:
        yield next(iter(parts)), read_recording(list(parts), robot, domain, topics)
