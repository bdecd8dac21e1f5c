"""The paper's performance models for its two actions, and its accuracies beside ours (paper, section 3)."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator

import numpy as np
import pandas as pd

from ator_ros.actions.base import Point
from ator_ros.actions.situation import Situation, drawn_until
from ator_ros.actions.specification import Sampler
from ator_ros.domains.measurements import PaperRun
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.experience.collect import collect
from ator_ros.experience.table import join
from ator_ros.performance.accuracy import accuracy
from ator_ros.performance.features import PAPER_3, PAPER_6, PAPER_11
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.training import Training, train
from ator_ros.robot.description import Robot
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
    drawn = drawn_until(
        lambda: sample(robot, rng),
        lambda one: bool(one.objects) and one.goal.point is Point.HOLD,
        lambda: f"expected a situation with a ball for robot {robot.name}",
    )
    resting = {name: ObjectState(there.x, there.y) for name, there in drawn.objects.items()}
    goal = dataclasses.replace(drawn.goal, speed=0.0)
    return Situation(drawn.action, RobotState(drawn.robot.pose), resting, goal)


def episodes_at_rest(
    robot: Robot, action: str, action_set: str, *, count: int, seed: int, jobs: int
) -> pd.DataFrame:
    """Return the examples of `count` episodes at rest of one action."""
    spec = SOCCER.actions(action_set)[action]
    spec = dataclasses.replace(spec, sample=functools.partial(at_rest, spec.sample))
    tops, objects = SOCCER.tops_for(robot), SOCCER.objects
    return join(collect([spec], tops, robot, objects=objects, episodes=count, seed=seed, jobs=jobs))


def document(asked: PaperRun) -> str:
    """Return the table of accuracies and the rules as Markdown."""
    robot = SOCCER.robot()
    rows: list[str] = []
    rules: list[str] = []
    for action, (mae, rmse) in PAPER.items():
        experience, fresh = (
            episodes_at_rest(robot, action, asked.action_set, count=count, seed=seed, jobs=asked.jobs)
            for count, seed in ((asked.episodes, asked.seed), (asked.fresh, asked.fresh_seed))
        )
        for label, model in _models(robot, action, experience):
            found = accuracy(model, fresh[fresh["t"] == 0.0], seed=asked.fresh_seed)
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
        f"# The paper's performance models for the set `{asked.action_set}`",
        "",
        f"Made by `{asked.command}`: {asked.episodes} episodes of each action to learn from",
        f"(seed {asked.seed}), {asked.fresh} fresh ones to measure on (seed {asked.fresh_seed}),",
        "at rest at both ends. Times in s.",
        "",
        "| action | candidates, learned from | MAE / RMSE | paper | mean duration | rules | features used |",
        "| --- | --- | --- | --- | --- | --- | --- |",
        *rows,
        *rules,
    ]
    return "\n".join(lines) + "\n"


def _models(robot: Robot, action: str, experience: pd.DataFrame) -> Iterator[tuple[str, PerformanceModel]]:
    for label, (features, training) in LEARNED.items():
        yield label, train(action, experience, robot, features=features, training=training)
