"""The paper in one file: it decides as the product does, and prints Table 1."""

import re
import subprocess
import sys
from collections.abc import Mapping

import numpy as np
import pandas as pd
import pytest

from ator_ros.domains.domain import find_domain
from ator_ros.domains.soccer.field import BALL
from ator_ros.domains.trials import random_trial
from ator_ros.experience.simulated import run_episode
from ator_ros.experience.table import Episode
from ator_ros.geometry import FloatArray, wrap_angle
from ator_ros.performance.features import PAPER_11
from ator_ros.performance.training import train
from ator_ros.refinement.refiner import Refiner
from ator_ros.simulation.scene_simulation import Simulation
from ator_ros.tops.library import top_of
from examples import paper_in_one_file as example

SOCCER = find_domain("soccer")

ROBOT = SOCCER.robot()
LIBRARY = SOCCER.library(ROBOT, "bezier")
ACTIONS = SOCCER.actions("bezier")
GRID_STEP = example.HEADINGS[1] - example.HEADINGS[0]


def invented_rows(action: str, *, episodes: int) -> pd.DataFrame:
    """Return experience that was not executed: the durations have kinks, as those of real runs."""
    rng, rows = np.random.default_rng(3), []
    for number in range(episodes):
        drawn = ACTIONS[action].sample(ROBOT, rng)
        *_, dist, to_dest, at_dest = example.features_of(
            example.situation_of(drawn.robot.pose, drawn.goal)[None]
        )[0]
        duration = (
            1.0
            + 1.5 * dist
            + 2.0 * max(to_dest - 1.0, 0.0)
            + min(at_dest, 1.5) * (2.5 - 0.5 * dist)
        )
        noisy = float(duration + 4.0 + rng.normal(0.0, 0.05))
        episode = Episode(drawn, noisy, True, "invented", 0.0, 0.0)
        rows.append(episode.rows(number, (BALL,)))
    return pd.concat(rows, ignore_index=True)


def learned(rows: pd.DataFrame) -> example.Node:
    starts = rows[(rows["t"] == 0.0) & rows["success"]]
    direct = starts[["x", "y", "yaw", "xg", "yg", "yawg"]].to_numpy()
    situations = np.column_stack([direct, ROBOT.hold * starts["hold"]])
    return example.learn(example.features_of(situations), starts["duration"].to_numpy())


def differences(experience: Mapping[str, pd.DataFrame]) -> FloatArray:
    """Return by how much naive and refined headings (rad) differ from the product's.

    Shape (20, 2).
    """
    refiner = Refiner(
        ROBOT, {a: train(a, rows, ROBOT, features=PAPER_11) for a, rows in experience.items()}
    )
    models = {action: learned(rows) for action, rows in experience.items()}
    found = []
    for index in range(20):
        trial = random_trial(SOCCER, "dribble", LIBRARY, seed=77, index=index)
        task = example.Task(trial.world, *(call.goal for call in trial.chain.calls))
        naive = refiner.naive(trial.world, trial.chain)
        chains = naive, refiner.refine(trial.world, trial.chain, placeholders=True).best
        headings = [chain.calls[0].goal.pose.yaw for chain in chains]
        ours = example.choose_headings(models, task)
        found.append([abs(wrap_angle(a - b)) for a, b in zip(ours, headings, strict=True)])
    return np.array(found)


def test_it_chooses_as_the_product_does_from_invented_experience() -> None:
    experience = {action: invented_rows(action, episodes=200) for action in example.CHAIN}
    assert all(len(list(example.rules(learned(rows)))) > 3 for rows in experience.values())
    assert (np.mean(differences(experience) <= GRID_STEP + 1e-9, axis=0) >= 0.95).all()


@pytest.mark.parametrize("action", example.CHAIN)
def test_its_observations_are_those_of_the_product(action: str) -> None:
    situation, duration = example.observe(action, 2, 0)
    drawn = ACTIONS[action].sample(
        ROBOT, np.random.default_rng([2, example.CHAIN.index(action), 0])
    )
    with Simulation(ROBOT) as simulation:
        top = top_of(drawn, SOCCER.tops_for(ROBOT), ROBOT)
        episode = run_episode(simulation, ACTIONS[action].factory(ROBOT), drawn, top=top)
    assert episode.success
    assert duration == pytest.approx(episode.duration)
    assert situation[:6] == pytest.approx([*drawn.robot.pose, *drawn.goal.pose])


@pytest.mark.long
def test_it_prints_rules_and_table_1() -> None:
    command = [sys.executable, example.__file__]
    command += ["--episodes", "30", "--situations", "2"]
    printed = subprocess.run(
        command, capture_output=True, text=True, check=True, timeout=300
    ).stdout
    actions = re.findall(
        r"^(\w+): mean absolute error [\d.]+ s .*\nif .* then time = .*\*", printed, re.M
    )
    assert actions == list(example.CHAIN)
    halves = re.findall(
        r"^(Before|After) filtering +Total Higher +Equal +Lower\n# runs(.*)\n", printed, re.M
    )
    assert [half for half, _ in halves] == ["Before", "After"]
    for _, runs in halves:
        total, *groups = map(int, runs.split())
        assert total == sum(groups) == 2
