"""Tables and recordings, read and joined to one experience."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from ator_ros.actions import DEFAULT_SET
from ator_ros.experience.columns import ExperienceError
from ator_ros.experience.recordings import read_recording
from ator_ros.experience.records import Vocabulary
from ator_ros.experience.store import is_store, read_store
from ator_ros.experience.table import Experience, join, read_experience
from ator_ros.printable import quoted
from ator_ros.robot.description import Robot


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
        Tables (.parquet), recordings (.mcap, or the folder they are in), and stores of the node `learning`.
    robot : Robot
        The robot that all sources must be of.
    domain : Vocabulary
        The domain that all sources must be of; a table without a domain must have objects of this one.
    action_set : str, optional
        Action set of sources that do not name one; all others must name this one.
    topics : mapping, optional
        Topics of odometry and commands in recordings, see `read_recording`.

    Raises
    ------
    ExperienceError, FileError
        A source cannot be used, or they are of different robots, domains or action sets.
    """
    tables = [_read(path, robot, domain, action_set, topics) for path in paths]
    frames, shift = [], 0
    for table in tables:
        frames.append(table.frame.assign(episode=table.frame["episode"] + shift))
        shift = int(frames[-1]["episode"].max()) + 1
    sets = {table.metadata.get("action_set") or action_set or DEFAULT_SET for table in tables}
    sets |= {action_set} if action_set else set()
    if len(sets) > 1:
        raise ExperienceError(f"expected experience of one action set, got {', '.join(sorted(sets))}")
    joined = {
        "domain": domain.name,
        "action_set": sets.pop(),
        "records_left_out": sum(table.metadata.get("records_left_out", 0) for table in tables),
    }
    metadata = {**tables[0].metadata, **joined}
    for name in ("objects", "goal_variables"):  # the columns say which the joined table has
        metadata.pop(name, None)
    return Experience(join(frames), metadata, tuple(remark for table in tables for remark in table.remarks))


def _read(
    path: Path,
    robot: Robot,
    domain: Vocabulary,
    action_set: str | None,
    topics: Mapping[str, str] | None,
) -> Experience:
    if path.suffix == ".parquet":
        table = read_experience(path)
    elif is_store(path):
        table = read_store(path, action_set)
    elif path.suffix == ".mcap" or path.is_dir():
        table = read_recording(path, robot, domain, topics)
    else:
        raise ExperienceError(
            f"{path}: expected a table of collect (.parquet) or a recording (.mcap, or the folder it is in)"
        )
    found = table.metadata.get("domain")
    foreign = [name for name in table.objects if found is None and name not in domain.objects]
    if foreign or found not in (None, domain.name):
        there = f"a table with the objects {', '.join(foreign)}" if foreign else quoted(found)
        raise ExperienceError(
            f"{path}: metadata.domain: expected {domain.name!r}, got {there}: name its domain with --domain"
        )
    digest = table.metadata.get("robot_digest", robot.digest())
    if digest != robot.digest():
        raise ExperienceError(
            f"{path}: metadata.robot_digest: expected {robot.digest()} of {robot.name}, got {digest}: "
            "give its description with --robot, or collect again"
        )
    return table
