"""Tables and recordings, read and joined to one experience."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ator_ros.actions import DEFAULT_SET
from ator_ros.experience.columns import ExperienceError
from ator_ros.experience.recordings import USUAL, TopicNames, read_recording
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
    topics: TopicNames = USUAL,
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
    topics : TopicNames, optional
        The topics of odometry and commands in recordings.

    Raises
    ------
    ExperienceError
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
    path: Path, robot: Robot, domain: Vocabulary, action_set: str | None, topics: TopicNames
) -> Experience:
    if path.suffix == ".parquet":
        table = read_experience(path)
        _check_domain(path, table, domain)
    elif is_store(path):
        table = read_store(path, action_set)
        _check_domain(path, table, domain)
    elif path.suffix == ".mcap" or path.is_dir():
        table = read_recording(path, robot, domain, topics)
    else:
        raise ExperienceError(
            f"{path}: expected a table of collect (.parquet) or a recording (.mcap, or the folder it is in)"
        )
    digest = table.metadata.get("robot_digest", robot.digest())
    if digest != robot.digest():
        raise ExperienceError(
            f"{path}: metadata.robot_digest: expected {robot.digest()} of {robot.name}, got {digest}: "
            "give its description with --robot, or collect again"
        )
    return table


def _check_domain(path: Path, table: Experience, domain: Vocabulary) -> None:
    """Refuse a table of another domain; without a domain, one with objects of another domain."""
    found = table.metadata.get("domain")
    foreign = [name for name in table.objects if name not in domain.objects]
    if found == domain.name or (found is None and not foreign):
        return
    there = quoted(found) if found is not None else f"a table with the objects {', '.join(foreign)}"
    raise ExperienceError(
        f"{path}: metadata.domain: expected {domain.name!r}, got {there}: name its domain with --domain"
    )
