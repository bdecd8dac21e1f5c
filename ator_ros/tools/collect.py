"""Collect experience: execute each action from random situations in the simulator (paper, section 3).

The same command continues where it was interrupted.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import pandas as pd
from tqdm import tqdm

from ator_ros.actions import DEFAULT_SET
from ator_ros.domains.domain import Domain, domain_for
from ator_ros.evaluation.trials import possible_actions
from ator_ros.experience import collect as simulated
from ator_ros.experience.collect import FinishedEpisodes
from ator_ros.experience.columns import ExperienceError
from ator_ros.experience.parallel import BackendError, cluster
from ator_ros.experience.table import (
    Experience,
    join,
    library_versions,
    require_pyarrow,
    write_experience,
)
from ator_ros.files import portable_command, reserved
from ator_ros.robot.description import Robot
from ator_ros.tools.command_line import (
    add_factor,
    add_parallel_options,
    add_setting,
    destination,
    settled,
    whole,
    workers,
)
from ator_ros.tools.guard import INTERRUPTED, RESUMES, guarded, undisturbed

_EPISODE_BYTES = 10_000
"""More than the table needs for an episode: those of the default actions take 3.3 kB."""


def collect(
    actions: Sequence[str],
    out: Path,
    *,
    command: str,
    domain: str = "",
    robot: str = "",
    action_set: str = DEFAULT_SET,
    episodes: int = 1000,
    seed: int = 101,
    jobs: int = -1,
    backend: str = "loky",
    scheduler: str | None = None,
    over_ros: float | None = None,
) -> int:
    """Execute episodes of each action and write their table; those of an earlier call are kept.

    Parameters
    ----------
    actions : sequence of str
        Names of actions; those that the robot cannot execute are left out with a message.
    out : Path
        The table.
    command : str
        The command that asks for it, for the table.
    domain, robot : str
        Name or file of the domain and file of the robot's description; empty: the default ones.
    action_set : str
        Name of the set of actions.
    episodes, seed : int
        Episodes of each action, and the seed of their situations.
    jobs, backend, scheduler
        As for `ator_ros.experience.parallel`.
    over_ros : float, optional
        Drive over ROS with this real-time factor; by default in the simulator without ROS.

    Returns
    -------
    int
        0 if the table is whole, and `INTERRUPTED` or 1 if it is not.
    """
    require_pyarrow()
    of_domain = domain_for(domain, robot)
    described = of_domain.robot(robot or None)
    possible = _possible(of_domain, described, actions, action_set, over_ros=over_ros is not None)
    wanted = [(action, number) for action in possible for number in range(episodes)]
    folder, room = out.absolute().parent, _EPISODE_BYTES * len(wanted)
    # A full disk is reported before the work: the table is joined beside the finished episodes.
    with reserved(folder, 2 * room):
        pass
    identity = {
        "seed": seed,
        "robot": described.sections(),
        "domain": of_domain.name,
        "action_set": action_set,
        "over_ros": over_ros is not None,
        "versions": library_versions(),
    }
    finished = FinishedEpisodes(out, identity)
    with contextlib.closing(finished), reserved(folder, room), cluster(scheduler):
        there = frozenset(finished.frames)
        if over_ros is None:
            frames = simulated.collect(
                [of_domain.actions(action_set)[name] for name in possible],
                of_domain.tops_for(described),
                described,
                objects=of_domain.objects,
                episodes=episodes,
                seed=seed,
                jobs=jobs,
                backend=backend,
                time_limit=of_domain.time_limit,
                finished=there,
            )
        else:
            try:
                from ator_ros.tools.client import drives  # needs ROS
            except ImportError as error:
                raise ExperienceError(f"--over-ros: {error}: source your ROS 2 workspace") from error
            missing = [key for key in wanted if key not in there]
            frames = drives(
                of_domain, described, missing, action_set=action_set, seed=seed, files=(domain, robot),
                factor=over_ros,
            )  # fmt: skip
        stopped = _execute(frames, finished, wanted)
        done = [finished.frames[key] for key in wanted if key in finished.frames]
        if stopped is not None and not done:
            raise stopped
    with undisturbed():
        metadata = {
            "seed": seed,
            "robot_digest": described.digest(),
            "domain": of_domain.name,
            "action_set": action_set,
            "complete": stopped is None,
            "command": command,
            "versions": library_versions(),
        }
        frame = join(done)
        file = _kept(Experience(frame, metadata), out)
        _report(frame, file, stopped)
        if stopped is None and file == out:
            finished.remove()
    if isinstance(stopped, KeyboardInterrupt):
        return INTERRUPTED
    return 0 if stopped is None and file == out else 1


def _possible(
    domain: Domain, robot: Robot, actions: Sequence[str], action_set: str, *, over_ros: bool
) -> list[str]:
    """Return those of the actions that the robot can execute; report why it cannot execute the others."""
    _, left_out = possible_actions(domain, action_set, robot)
    if not over_ros:
        specs = domain.actions(action_set)
        left_out |= {name: why for name, spec in specs.items() if (why := spec.over_ros_only) is not None}
    without = {name: left_out[name] for name in actions if name in left_out}
    if len(without) == len(actions):
        raise ExperienceError("; ".join(without.values()))
    for name, reason in without.items():
        print(f"collect: without {name}: {reason}", file=sys.stderr)
    return [name for name in actions if name not in without]


def _execute(
    frames: Iterator[pd.DataFrame], finished: FinishedEpisodes, wanted: Sequence[tuple[str, int]]
) -> BaseException | None:
    """Keep each episode as it comes; return the error that stopped it, if any."""
    done = sum(key in finished.frames for key in wanted)
    if done:
        print(f"collect: {done} episodes of an earlier call are there", file=sys.stderr)
    often = 0.1 if sys.stderr.isatty() else 30.0  # s; a log gets a line now and then
    bar = tqdm(frames, initial=done, total=len(wanted), unit="episode", mininterval=often, delay=often - 0.1)
    try:
        for frame in bar:
            finished.add(frame)
    except (KeyboardInterrupt, BackendError, OSError) as error:
        return error
    finally:
        bar.close()
    return None


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


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `collect`."""
    parser = argparse.ArgumentParser(prog="collect", description=__doc__)
    add_setting(parser)
    parser.add_argument("--actions", nargs="+", metavar="NAME", help="default: all of the domain")
    parser.add_argument("--episodes", type=whole(1), default=1000, help="per action (default: %(default)s)")
    parser.add_argument("--seed", type=whole(), default=101, help="the same seed gives the same table")
    add_parallel_options(parser)
    parser.add_argument(
        "--over-ros",
        action="store_true",
        help="drive over ROS, with the domain's action servers, and learn from the executor's records; one "
        "drive at a time, whatever --jobs says",
    )
    add_factor(parser, 0.0)
    parser.add_argument(
        "--out",
        type=_table,
        default=Path("experience.parquet"),
        metavar="FILE.parquet",
        help="default: %(default)s",
    )
    return parser


def _table(text: str) -> Path:
    path = destination(text)
    if path.suffix != ".parquet":  # by which train and evaluate know a table
        raise argparse.ArgumentTypeError(f"expected a file named .parquet, got {text!r}")
    return path


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    action_set = arguments().parse_args(words).action_set  # which need not have the actions of the others
    options, _ = settled(arguments(), words, actions=lambda domain: domain.actions(action_set))

    def run() -> int:
        return collect(
            options.actions,
            options.out,
            command=portable_command("collect", words),
            domain=options.domain,
            robot=options.robot,
            action_set=options.action_set,
            episodes=options.episodes,
            seed=options.seed,
            over_ros=options.real_time_factor if options.over_ros else None,
            **workers(options),
        )

    return guarded("collect", run, interrupted=RESUMES)


if __name__ == "__main__":
    sys.exit(main())
