"""Measure the actions of soccer: success, duration, and its change with the start.

scripts/run python benchmarks/actions.py --out actions.md
scripts/run python benchmarks/actions.py --action-set bezier --out actions_bezier.md
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from ator_ros.domains.domain import find_domain
from ator_ros.experience.parallel import progress, run_tasks, workers
from ator_ros.experience.simulated import episode_generator, run_episode
from ator_ros.experience.table import Episode
from ator_ros.files import portable_command, write_text
from ator_ros.geometry import wrap_angle
from ator_ros.simulation.scene_simulation import Simulation
from ator_ros.tops.library import top_of

TURN = math.radians(1.0)  # rad, change of the heading at the start
TEXT = """# How the actions perform (set `{action_set}`)

{situations} random situations of each action, seed {seed}, drawn as for experience. *Turned by 1°*
is the change of duration if the start's heading changes by one degree: 95th and 99th percentile.
A control tick is 0.05 s.

    {command}

| action | success | mean duration | turned by 1° |
| --- | --- | --- | --- |
{rows}

{failed}
"""


def run_both(
    task: tuple[str, int],
    *,
    action_set: str,
    seed: int,
) -> tuple[Episode, Episode]:
    """Return the episode of a situation, and of the same situation with the robot turned by 1°.

    `task` are the name of the action and the number of the situation.
    """
    name, number = task
    domain = find_domain("soccer")
    robot = domain.robot()
    spec = domain.actions(action_set)[name]
    situation = spec.sample(robot, episode_generator(name, seed, number))
    pose = situation.robot.pose
    turned_pose = pose._replace(yaw=wrap_angle(pose.yaw + TURN))
    turned = dataclasses.replace(situation.robot, pose=turned_pose)
    episodes = []
    for drawn in (situation, dataclasses.replace(situation, robot=turned)):
        with Simulation(robot) as simulation:
            top = top_of(drawn, domain.tops, robot)
            episodes.append(run_episode(simulation, spec.factory(robot), drawn, top=top))
    return episodes[0], episodes[1]


def measure(
    action_set: str,
    situations: int,
    seed: int,
) -> tuple[list[str], str]:
    """Return the rows of the table in Markdown, and a text about failures."""
    names = tuple(find_domain("soccer").actions(action_set))
    tasks = [(name, number) for name in names for number in range(situations)]
    run = partial(run_both, action_set=action_set, seed=seed)
    with workers(-1):
        found = list(progress(run_tasks(run, tasks), done=0, total=len(tasks), unit="situation"))
    rows = []
    failures = Counter[str]()
    for name in names:
        pairs = [pair for (action, _), pair in zip(tasks, found, strict=True) if action == name]
        failures.update(f"{name}: {first.reason}" for first, _ in pairs if not first.success)
        both_succeeded = [pair for pair in pairs if pair[0].success and pair[1].success]
        good = [(first.duration, other.duration) for first, other in both_succeeded]
        success = np.mean([first.success for first, _ in pairs])
        measured = "- | -"
        if good:
            durations, turned = np.array(good).T
            change = np.quantile(np.abs(turned - durations), [0.95, 0.99])
            measured = f"{durations.mean():.2f} s | {change[0]:.2f} / {change[1]:.2f} s"
        rows.append(f"| {name} | {success:.1%} | {measured} |")
    failed = "\n".join(f"* {count} x {reason}" for reason, count in failures.most_common())
    return rows, f"What failed:\n\n{failed}" if failed else "Nothing failed."


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    parser = argparse.ArgumentParser(prog="actions", description=__doc__)
    parser.add_argument("--action-set", default="default")
    parser.add_argument("--situations", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=901)
    parser.add_argument("--out", type=Path, help="a page (default: print)")
    options = parser.parse_args(argv)
    rows, failed = measure(options.action_set, options.situations, options.seed)
    page = TEXT.format(
        action_set=options.action_set,
        situations=options.situations,
        seed=options.seed,
        command=portable_command("actions.py", sys.argv[1:] if argv is None else argv),
        rows="\n".join(rows),
        failed=failed,
    )
    if options.out is None:
        print(page)
    else:
        write_text(options.out, page)
    return 0


if __name__ == "__main__":
    sys.exit(main())
