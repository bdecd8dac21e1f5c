"""Collect experience: execute each action from random situations in the simulator (paper, section 3)."""

from __future__ import annotations

import argparse
import contextlib
import sys
import tempfile
from collections.abc import Container, Iterator, Sequence
from pathlib import Path

import pandas as pd
from tqdm import tqdm

from ator_ros.domains.domain import Domain
from ator_ros.experience.collect import collect
from ator_ros.experience.errors import ExperienceError
from ator_ros.experience.finished import FinishedEpisodes
from ator_ros.experience.parallel import BackendError, cluster
from ator_ros.experience.table import (
    Experience,
    join,
    library_versions,
    require_pyarrow,
    write_experience,
)
from ator_ros.files import reserved
from ator_ros.robot.description import Robot
from ator_ros.tools.guard import INTERRUPTED, RESUMES, undisturbed
from ator_ros.tools.work.possible import possible_actions

_EPISODE_BYTES = 10_000
"""More than the table needs for an episode: those of the default actions take 3.3 kB."""


def run(options: argparse.Namespace, domain: Domain, command: str) -> int:
    """Do what the command line asks for; return the exit code."""
    require_pyarrow()
    robot = domain.robot(options.robot or None)
    options.actions = _possible(options, domain, robot)
    wanted = [(action, number) for action in options.actions for number in range(options.episodes)]
    folder, room = options.out.absolute().parent, _EPISODE_BYTES * len(wanted)
    # A full disk is reported before the work: the table is joined beside the finished episodes.
    with reserved(folder, 2 * room):
        pass
    identity = {
        "seed": options.seed,
        "robot": robot.sections(),
        "domain": domain.name,
        "action_set": options.action_set,
        "over_ros": options.over_ros,
        "versions": library_versions(),
    }
    finished = FinishedEpisodes(options.out, identity)
    with contextlib.closing(finished), reserved(folder, room), cluster(options.cluster):
        stopped = _collect(options, domain, robot, finished, wanted)
        frames = [finished.frames[key] for key in wanted if key in finished.frames]
        if stopped is not None and not frames:
            raise stopped
    with undisturbed():
        metadata = {
            "seed": options.seed,
            "robot_digest": robot.digest(),
            "domain": domain.name,
            "action_set": options.action_set,
            "complete": stopped is None,
            "command": command,
            "versions": library_versions(),
        }
        frame = join(frames)
        file = _kept(Experience(frame, metadata), options.out)
        _report(frame, file, stopped)
        if stopped is None and file == options.out:
            finished.remove()
    if isinstance(stopped, KeyboardInterrupt):
        return INTERRUPTED
    return 0 if stopped is None and file == options.out else 1


def _collect(
    options: argparse.Namespace,
    domain: Domain,
    robot: Robot,
    finished: FinishedEpisodes,
    wanted: Sequence[tuple[str, int]],
) -> BaseException | None:
    """Execute the episodes that are missing, and keep each; return what has stopped it, None if nothing."""
    done = sum(key in finished.frames for key in wanted)
    if done:
        print(f"collect: {done} episodes of an earlier call are there", file=sys.stderr)
    drive = _over_ros if options.over_ros else _simulated
    episodes = drive(options, domain, robot, frozenset(finished.frames))
    often = 0.1 if sys.stderr.isatty() else 30.0  # s; a log gets a line now and then
    bar = tqdm(
        episodes, initial=done, total=len(wanted), unit="episode", mininterval=often, delay=often - 0.1
    )
    try:
        for frame in bar:
            finished.add(frame)
    except (KeyboardInterrupt, BackendError, OSError) as error:
        return error
    finally:
        bar.close()
    return None


def _possible(options: argparse.Namespace, domain: Domain, robot: Robot) -> list[str]:
    """Return those of the actions that the robot can execute; tell why it can't the others."""
    _, left_out = possible_actions(domain, options.action_set, robot)
    if not options.over_ros:
        specs = domain.actions(options.action_set)
        left_out |= {name: why for name, spec in specs.items() if (why := spec.over_ros_only) is not None}
    wanted: list[str] = options.actions
    without = {name: left_out[name] for name in wanted if name in left_out}
    if len(without) == len(wanted):
        raise ExperienceError("; ".join(without.values()))
    for name, reason in without.items():
        print(f"collect: without {name}: {reason}", file=sys.stderr)
    return [name for name in wanted if name not in without]


def _simulated(
    options: argparse.Namespace, domain: Domain, robot: Robot, finished: Container[tuple[str, int]]
) -> Iterator[pd.DataFrame]:
    return collect(
        [domain.actions(options.action_set)[name] for name in options.actions],
        domain.tops_for(robot),
        robot,
        objects=domain.objects,
        episodes=options.episodes,
        seed=options.seed,
        jobs=options.jobs,
        backend=options.backend,
        time_limit=domain.time_limit,
        finished=finished,
    )


def _over_ros(
    options: argparse.Namespace, domain: Domain, robot: Robot, finished: Container[tuple[str, int]]
) -> Iterator[pd.DataFrame]:
    try:
        from ator_ros.tools.work.collect_over_ros import drives
    except ImportError as error:
        raise ExperienceError(f"--over-ros: {error}: source your ROS 2 workspace") from error
    yield from drives(options, domain, robot, finished)


def _kept(experience: Experience, file: Path) -> Path:
    """Write the table to `file`, or if that fails to a temporary folder; return the path."""
    try:
        write_experience(file, experience)
        return file
    except OSError as error:
        other = Path(tempfile.mkdtemp(prefix="ator_ros-"), file.name)
        print(f"collect: {file}: {error.strerror or error}: the table goes to {other}", file=sys.stderr)
        write_experience(other, experience)
        return other


def _report(frame: pd.DataFrame, file: Path, stopped: BaseException | None) -> None:
    for action, rows in frame.groupby("action", sort=False):
        ends = rows.drop_duplicates("episode", keep="last")
        print(
            f"{action}: {len(ends)} episodes, {len(rows)} examples, {100 * ends['success'].mean():.2f} % "
            f"succeeded, mean duration {ends['duration'].mean():.2f} s"
        )
        for reason, count in ends.loc[~ends["success"], "reason"].value_counts().head(5).items():
            print(f"  failed {count} times: {reason}")
    if stopped is None:
        print(f"wrote {file}")
    else:
        why = str(stopped) or "interrupted"
        print(f"{why}; kept the finished episodes in {file}; {RESUMES}")
