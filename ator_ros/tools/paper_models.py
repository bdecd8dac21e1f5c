"""The paper's performance models: its candidate features and amount of experience (paper, section 3)."""

from __future__ import annotations

import argparse
import dataclasses
import functools
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from ator_ros.actions.situation import Situation
from ator_ros.actions.specification import Sampler
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.experience.collect import collect
from ator_ros.experience.table import join
from ator_ros.files import portable_command, write_text
from ator_ros.performance.accuracy import accuracy
from ator_ros.performance.features import PAPER_3, PAPER_6, PAPER_11
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.training import Training, train
from ator_ros.robot.description import Robot, load_robot
from ator_ros.tools.command_line import add_jobs
from ator_ros.tools.guard import guarded
from ator_ros.tools.option_types import destination, whole
from ator_ros.world.state import ObjectState, RobotState

PAPER = {"goToPose": (0.31, 0.75), "dribbleBall": (0.29, 0.73)}
"""The paper's mean absolute and root-mean-square errors in s; the first is of its goToBall routine."""

LEARNED = {
    "the 6 direct variables, starts": (PAPER_6, Training()),
    "its 11, all examples at 10 Hz": (PAPER_11, Training(later_weight=1.0)),
    "its 11, starts of episodes": (PAPER_11, Training()),
    "the 3 its trees chose, starts": (PAPER_3, Training()),
}
"""Candidate features and examples to learn from, by what the table calls them."""


def at_rest(sample: Sampler, robot: Robot, rng: np.random.Generator) -> Situation:
    """Draw a situation as the paper's: at rest at both ends, the ball at the goal of goToPose or held."""
    drawn = sample(robot, rng)
    while not drawn.objects:
        drawn = sample(robot, rng)
    resting = {name: ObjectState(there.x, there.y) for name, there in drawn.objects.items()}
    goal = dataclasses.replace(drawn.goal, speed=0.0)
    return Situation(drawn.action, RobotState(drawn.robot.pose), resting, goal)


def episodes_at_rest(action: str, action_set: str, count: int, seed: int, jobs: int) -> pd.DataFrame:
    """Return the examples of `count` episodes at rest of one action."""
    spec = SOCCER.actions(action_set)[action]
    spec = dataclasses.replace(spec, sample=functools.partial(at_rest, spec.sample))
    robot, tops, objects = load_robot(), SOCCER.tops, SOCCER.objects
    return join(collect([spec], tops, robot, objects=objects, episodes=count, seed=seed, jobs=jobs))


def document(options: argparse.Namespace, command: str) -> str:
    """Return the table of accuracies and the rules as Markdown."""
    rows: list[str] = []
    rules: list[str] = []
    for action, (mae, rmse) in PAPER.items():
        experience, fresh = (
            episodes_at_rest(action, options.action_set, count, seed, options.jobs)
            for count, seed in ((options.episodes, options.seed), (options.fresh, options.fresh_seed))
        )
        for label, model in _models(action, experience):
            found = accuracy(model, fresh[fresh["t"] == 0.0], seed=options.fresh_seed)
            used, leaves = model.used_features, model.trees["duration"].n_leaves
            rows.append(
                f"| {action} | {label} | {found['mae_s']:.2f} / {found['rmse_s']:.2f} | {mae} / {rmse} "
                f"| {found['mean_duration_s']:.2f} | {leaves} | {len(used)}: {', '.join(used)} |"
            )
            if label == list(LEARNED)[-1]:
                rules += [
                    "",
                    f"## Rules of {action} with the paper's 3 features",
                    "",
                    "```",
                    model.rules(),
                    "```",
                ]
    lines = [
        f"# The paper's performance models for the set `{options.action_set}`",
        "",
        f"Made by `{command}`: {options.episodes} episodes of each action to learn from",
        f"(seed {options.seed}), {options.fresh} fresh ones to measure on (seed {options.fresh_seed}),",
        "at rest at both ends. Times in s.",
        "",
        "| action | candidates, learned from | MAE / RMSE | paper | mean duration | rules | features used |",
        "| --- | --- | --- | --- | --- | --- | --- |",
        *rows,
        *rules,
    ]
    return "\n".join(lines) + "\n"


def _models(action: str, experience: pd.DataFrame) -> Iterator[tuple[str, PerformanceModel]]:
    for label, (features, training) in LEARNED.items():
        yield label, train(action, experience, load_robot(), features=features, training=training)


def main(argv: Sequence[str] | None = None) -> int:
    """Collect, learn, measure, and write the table; return the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    parser = argparse.ArgumentParser(prog="paper_models", description=__doc__)
    parser.add_argument("--action-set", choices=list(SOCCER.action_sets), default="bezier")
    parser.add_argument(
        "--episodes", type=whole(20), default=1000, help="of each action (default: %(default)s)"
    )
    parser.add_argument("--fresh", type=whole(20), default=1000, help="fresh ones (default: %(default)s)")
    parser.add_argument("--seed", type=whole(), default=111)
    parser.add_argument("--fresh-seed", type=whole(), default=221)
    add_jobs(parser)
    parser.add_argument("--out", type=destination, default=Path("docs/accuracy_paper.md"))
    options = parser.parse_args(words)
    return guarded("paper_models", _writer(options, portable_command("paper_models", words)))


def _writer(options: argparse.Namespace, command: str) -> Callable[[], int]:
    def write() -> int:
        text = document(options, command)
        write_text(options.out, text)
        print(text)
        return 0

    return write


if __name__ == "__main__":
    sys.exit(main())
