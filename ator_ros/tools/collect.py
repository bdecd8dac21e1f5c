"""Collect experience: execute each action in random situations (paper, section 3).

After an interruption, the same command resumes.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ator_ros.bases.description import Robot
from ator_ros.domains.domain import Domain
from ator_ros.domains.trials import possible_actions
from ator_ros.evaluation.toolset import ToolsetSource
from ator_ros.experience import simulated
from ator_ros.experience.json_lines import PartialResults
from ator_ros.experience.parallel import progress
from ator_ros.experience.recordings import read_sources
from ator_ros.experience.table import (
    Experience,
    ExperienceError,
    checked_rows,
    join,
    library_versions,
    write_experience,
)
from ator_ros.files import FileError
from ator_ros.geometry import FloatArray, wrap_angles
from ator_ros.performance.coverage import Coverage, Unlike
from ator_ros.printable import one_line, quoted
from ator_ros.tools.command_line import (
    RESUMES,
    add_factor,
    add_nav2,
    add_parallel_options,
    add_setting,
    destination,
    run_tool,
    source_of,
    whole,
    without_ros_arguments,
)

# share of failed episodes that is reported: the actions of the domains fail more rarely
_OFTEN = 0.2
# duration, as a multiple of a straight drive and turns at the robot's limits, that is reported: the
# drives of the shipped robots and servers take 0.7 to 1.3 times as long
_LONG = 4.0
_FEWEST = 5  # episodes for such a report


@dataclass(frozen=True)
class Attachment:
    """How to drive with nodes that are already running.

    `places` is a YAML file with a list of places to drive to. Unless `confirmed`, the user must
    agree first. `arguments` are ROS arguments, such as the namespace of the robot's nodes.
    """

    places: Path | None
    confirmed: bool
    arguments: Sequence[str]


def collect(
    actions: Sequence[str],
    source: ToolsetSource,
    out: Path,
    *,
    command: str,
    episodes: int = 1000,
    seed: int = 101,
    over_ros: float | None = None,
    attachment: Attachment | None = None,
    beside: Sequence[Path] = (),
) -> None:
    """Execute `episodes` of each action and write their table.

    Episodes of an interrupted call are reused. Actions that the robot cannot execute are skipped
    with a message. `command` is the command line for the table. With `over_ros`, a real-time
    factor, actions are executed over ROS; with an `attachment`, by the running executor; otherwise
    in the simulator without ROS. Situations are unlike those of the experience in `beside`.
    """
    import pyarrow.parquet  # noqa: F401 (reports a missing package before the first episode)

    domain = source.in_domain()
    robot = source.described()
    is_over_ros = over_ros is not None
    if attachment is None:
        _, left_out = possible_actions(domain, source.action_set, robot, over_ros=is_over_ros)
    else:
        from ator_ros.tools.over_ros import attached_drives, driven_tops  # needs ROS

        expected = "expected a TOP that drives to its goal and needs no object"
        drivable = driven_tops(domain, robot)
        left_out = {name: f"{name}: {expected}" for name in actions if name not in drivable}
    possible = [name for name in dict.fromkeys(actions) if name not in left_out]
    skipped = {name: left_out[name] for name in actions if name in left_out}
    if not possible:
        raise ExperienceError("; ".join(skipped.values()))
    for name, reason in skipped.items():
        print(one_line(f"collect: skipped {name}: {reason}"), file=sys.stderr)
    settings = {"seed": seed, "domain": domain.name, "action_set": source.action_set}
    if domain.grid is not None:
        settings["map"] = str(domain.grid)
    settings["versions"] = library_versions()
    if beside:
        domain = _unlike(domain, source, robot, beside)
        settings["beside"] = [path.name for path in beside]
    identity = {**settings, "robot": robot.sections(), "over_ros": is_over_ros}
    if attachment is not None:
        identity["attached"] = True
    file = out.with_suffix(".episodes.jsonl")
    if attachment is not None and out.exists() and not file.exists():
        raise FileError(f"--out: {out} has the drives of a finished command; name another file")
    wanted = [(action, number) for action in possible for number in range(episodes)]
    contents = "episodes of the same seed, robot, domain, action set and versions"
    with PartialResults(file, identity, contents) as partial:
        finished = _finished(file, partial.results, source.action_set)
        missing = [key for key in wanted if key not in finished]
        done = len(wanted) - len(missing)
        if done:
            print(f"collect: {done} episodes of an earlier call are reused", file=sys.stderr)
        if missing and attachment is not None:
            collected = attached_drives(domain, missing, source, seed, **asdict(attachment))
        elif missing and over_ros is not None:
            from ator_ros.tools.over_ros import simulated_drives

            collected = simulated_drives(domain, missing, source, seed, over_ros)
        else:
            if missing:
                names = ", ".join(dict.fromkeys(action for action, _ in missing))
                print(
                    f"collect: {len(missing)} episodes of {names} in the simulator; the first take "
                    "longer: each process loads or compiles code, up to a minute",
                    file=sys.stderr,
                    flush=True,
                )
            collected = simulated.collect(
                [domain.actions(source.action_set)[name] for name in possible],
                domain.tops_for(robot),
                robot,
                objects=domain.objects,
                episodes=episodes,
                seed=seed,
                time_limit=domain.time_limit,
                finished=frozenset(finished),
            )
        try:
            with contextlib.closing(collected):  # ends workers and nodes, and stops the robot
                for frame in progress(collected, done=done, total=len(wanted), unit="episode"):
                    partial.append(frame.to_dict("list"))
                    finished[_key(frame)] = frame
        finally:
            kept = [finished[key] for key in wanted if key in finished]
            # a robot's drives are precious
            if len(kept) == len(wanted) or (kept and attachment is not None):
                metadata = {**settings, "robot_digest": robot.digest(), "command": command}
                write_experience(out, Experience(join(kept), metadata))
                _report(join(kept), robot)
                print(f"wrote {out}")
    file.unlink()


def _unlike(
    domain: Domain, source: ToolsetSource, robot: Robot, experience: Sequence[Path]
) -> Domain:
    """Return the domain with situations that are unlike those of earlier experience."""
    rows = read_sources(experience, robot, domain, source.action_set).frame
    starts = rows[rows["t"] == 0.0]
    specs = tuple(
        replace(spec, sample=Unlike(spec.sample, Coverage(starts[starts["action"] == name], robot)))
        for name, spec in domain.actions(source.action_set).items()
    )
    return replace(domain, action_sets={**domain.action_sets, source.action_set: specs})


def _finished(
    file: Path, results: Sequence[Any], action_set: str
) -> dict[tuple[str, int], pd.DataFrame]:
    """Return the episodes of an earlier call by their keys.

    Raises FileError or ExperienceError if one is damaged.
    """
    try:
        frames = {_key(frame): frame for frame in map(pd.DataFrame, results)}
        if frames:
            checked_rows(file, join(frames.values()), action_set)
    except ExperienceError:
        raise
    except (LookupError, TypeError, ValueError) as error:
        raise FileError(f"{file}: expected episodes, one a line: {error}") from error
    return frames


def _key(frame: pd.DataFrame) -> tuple[str, int]:
    """Return action and number of an episode."""
    return frame["action"].iloc[0], int(frame["episode"].iloc[0])


def _report(frame: pd.DataFrame, robot: Robot) -> None:
    for action, rows in frame.groupby("action", sort=False):
        ends = rows.drop_duplicates("episode", keep="last")
        succeeded = 100.0 * ends["success"].mean()
        print(
            f"{action}: {len(ends)} episodes, {len(rows)} examples, {succeeded:.2f} % succeeded, "
            f"mean duration {ends['duration'].mean():.2f} s"
        )
        for reason, count in ends.loc[~ends["success"], "reason"].value_counts().head(5).items():
            print(f"  failed {count} times: {one_line(reason)}")
        for remark in _remarks(rows.drop_duplicates("episode"), robot):
            print(f"  {remark}")


def _remarks(starts: pd.DataFrame, robot: Robot) -> list[str]:
    """Return what the user should check, by the starts of the episodes of an action."""
    remarks = []
    succeeded = starts[starts["success"].astype(bool)]
    failed = len(starts) - len(succeeded)
    if len(starts) >= _FEWEST and failed > _OFTEN * len(starts):
        remarks.append(
            f"{failed} of {len(starts)} failed: models of durations are learned from the others; "
            "check the server, the goals and the conditions of success"
        )
    ratios = succeeded["duration"] / _straight_times(succeeded, robot)
    if len(ratios) >= _FEWEST and ratios.median() > _LONG:
        limits = ", ".join(f"{axis.name} {axis.limit:g} {axis.unit}" for axis in robot.axes)
        remarks.append(
            f"drives took {ratios.median():.0f} times as long as the limits of {robot.name} allow "
            f"({limits}): check the limits, or the speed of the server"
        )
    return remarks


def _straight_times(starts: pd.DataFrame, robot: Robot) -> FloatArray:
    """Return times in s of straight drives with turns before and after, at the robot's limits."""
    dx = starts["xg"] - starts["x"]
    dy = starts["yg"] - starts["y"]
    distance = np.hypot(dx, dy).to_numpy()
    direction = np.arctan2(dy, dx)
    none = np.zeros(len(starts))
    first_turn = np.abs(wrap_angles(direction - starts["yaw"]))
    last_turn = np.abs(wrap_angles(starts["yawg"] - direction))
    return robot.route_time(distance, (first_turn, none, last_turn), none, none)


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `collect`."""
    parser = argparse.ArgumentParser(prog="collect", description=__doc__)
    add_setting(parser)
    add_nav2(parser)
    parser.add_argument(
        "--actions", nargs="+", default=[], metavar="NAME", help="default: all of the domain"
    )
    parser.add_argument(
        "--episodes", type=whole(1), help="per action (default: 1000; with --attach 100)"
    )
    parser.add_argument(
        "--beside", nargs="+", type=Path, default=[], metavar="FILE",
        help="earlier tables or recordings: drive where they varied nothing",
    )  # fmt: skip
    parser.add_argument(
        "--seed", type=whole(), default=101, help="the same seed gives the same table"
    )
    add_parallel_options(parser)
    parser.add_argument(
        "--over-ros", action="store_true",
        help="drive over ROS, with the domain's action servers, one drive at a time; the table "
        "holds the executor's records",
    )  # fmt: skip
    parser.add_argument(
        "--attach", action="store_true",
        help="with --over-ros: use the running executor instead of starting nodes; the table is "
        "also written after Ctrl-C",
    )  # fmt: skip
    parser.add_argument(
        "--places", type=Path, metavar="FILE",
        help="with --attach: YAML file with a list of places to drive to, such as "
        "[{x: [1.0], y: [2.0]}]",
    )  # fmt: skip
    parser.add_argument(
        "--yes", action="store_true", help="with --attach: do not ask before the first drive"
    )
    add_factor(parser, 0.0)
    parser.add_argument(
        "--out", type=_table, default=Path("experience.parquet"), metavar="FILE.parquet",
        help="default: %(default)s",
    )  # fmt: skip
    return parser


def _table(text: str) -> Path:
    path = destination(text)
    if path.suffix != ".parquet":  # train recognizes tables by the suffix
        raise argparse.ArgumentTypeError(
            f"expected a file with the suffix .parquet, got {quoted(text)}"
        )
    return path


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    own, ros = without_ros_arguments(sys.argv[1:] if argv is None else argv)
    parser = arguments()
    options = parser.parse_args(own)
    if options.attach and not options.over_ros:
        parser.error("--attach: expected --over-ros, too")
    if not options.attach and (options.places or options.yes or ros):
        parser.error("--places, --yes, --ros-args: expected --attach, too")
    attachment = Attachment(options.places, options.yes, ros) if options.attach else None

    def run(options: argparse.Namespace, _: Any, command: str) -> None:
        collect(
            options.actions, source_of(options), options.out, command=command,
            episodes=options.episodes or (100 if attachment else 1000), seed=options.seed,
            over_ros=options.real_time_factor if options.over_ros else None, attachment=attachment,
            beside=options.beside,
        )  # fmt: skip

    return run_tool(
        parser, run, own, interrupted=RESUMES,
        actions=lambda domain: domain.actions(options.action_set),
    )  # fmt: skip
