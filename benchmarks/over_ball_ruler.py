"""How long our actions take over the time-optimal motion of a robot that knows the ball.

Approaches and dribbles are those of `docs/ruler/pairs_KIND.json`; chains dribble a ball to a pose. Where the
folder has no chains yet, they are written there, for `benchmarks/time_optimal_ball.py`:
    scripts/run python benchmarks/over_ball_ruler.py --ruler docs/ruler --out docs/over_ball_ruler.json
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from ator_ros.actions.base import Goal, Point
from ator_ros.actions.situation import Situation
from ator_ros.domains.soccer.ball import objects_of
from ator_ros.domains.soccer.quality.action_quality import Task, execute_situation
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.evaluation.policies import POLICIES, Toolset
from ator_ros.evaluation.toolset import ToolsetSource, tools_of
from ator_ros.evaluation.trials import Trial, random_trial
from ator_ros.files import portable_command, read_json, write_text
from ator_ros.formats import Format
from ator_ros.geometry import Pose
from ator_ros.robot.description import Robot
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import ObjectState, RobotState

FORMAT = Format("ator_ros over ball ruler", 1, "comparison with time-optimal motion")
SEED = 903
ACTIONS = {"approach": "goToPose", "dribble": "dribbleBall"}
CHAINS = {"chain, at rest at the ball": "refined", "chain, without a stop": "refined_speed"}
"""Policies that choose the headings, and the arrival speeds, of the chains."""


def chains(tools: Toolset, library: TopLibrary, count: int) -> list[Trial]:
    """Return the situations of chains: a ball to go to and to dribble to a pose."""
    return [random_trial(tools.domain, "dribble", library, seed=SEED, index=i) for i in range(count)]


def as_points(trials: Sequence[Trial], robot: Robot) -> list[list[list[float]]]:
    """Return start, ball and goal of each chain (m, m, rad), start and goal of the axle."""
    return [
        [
            list(trial.world.robot.pose),
            list(trial.chain.calls[0].goal.pose[:2]),
            list(trial.chain.calls[1].goal.robot_pose(robot)),
        ]
        for trial in trials
    ]


def driven(kind: str, pairs: Sequence[Sequence[Sequence[float]]], robot: Robot) -> Iterator[float]:
    """Drive each pair of poses with one action; yield the durations in s, NaN where it fails."""
    for start, end in pairs:
        held = robot.hold_point(Pose(*(start if kind == "dribble" else end)))
        goal = Goal(robot.hold_point(Pose(*end)), 0.0, Point.HOLD)
        ball = objects_of(ObjectState(held.x, held.y))
        situation = Situation(ACTIONS[kind], RobotState(Pose(*start)), ball, goal)
        outcome = execute_situation(situation, Task(kind, "default", SEED, 0))
        yield outcome.duration if outcome.success else float("nan")


def executed(policy: str, trials: Sequence[Trial], tools: Toolset, library: TopLibrary) -> Iterator[float]:
    """Execute the chains that a policy chooses; yield the durations in s, NaN where they fail."""
    for trial in trials:
        run = run_chain(tools.robot, library, trial.world, POLICIES[policy](tools, trial).chain)
        yield run.duration if run.success else float("nan")


def row_of(name: str, own: Iterator[float], optimal: Sequence[float | None]) -> dict[str, object]:
    """Return the means of own and optimal times in s over what both have done, and their ratio."""
    both = np.array([pair for pair in zip(own, optimal, strict=True) if pair[1] is not None], dtype=float)
    both = both[np.isfinite(both[:, 0])]
    mean, best = both.mean(axis=0)
    draws = np.random.default_rng(0).integers(len(both), size=(5000, len(both)))
    ratios = np.divide(*both[draws].mean(axis=1).T)
    return {
        "what": name,
        "situations": len(both),
        "mean_s": round(mean, 3),
        "time_optimal_mean_s": round(best, 3),
        "ratio": round(mean / best, 3),
        "ratio_ci95": np.percentile(ratios, (2.5, 97.5)).round(3).tolist(),
    }


def main(words: list[str]) -> int:
    """Measure what the ruler's folder has times of; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ruler", type=Path, default=Path("docs/ruler"), metavar="DIR")
    parser.add_argument("--chains", type=int, default=20, metavar="N")
    parser.add_argument("--out", type=Path, default=Path("over_ball_ruler.json"))
    options = parser.parse_args(words)
    source = ToolsetSource()
    tools, library = tools_of(source)
    trials = chains(tools, library, options.chains)
    points, file = as_points(trials, tools.robot), options.ruler / "situations_chain.json"
    if not file.exists():
        write_text(file, json.dumps(points))
    if read_json(file) != points:
        print(f"{file}: expected the {len(points)} chains of seed {SEED}, got others", file=sys.stderr)
        return 2
    missing = [
        f"ball_{kind}.json"
        for kind in (*ACTIONS, "chain")
        if not (options.ruler / f"ball_{kind}.json").exists()
    ]
    if missing:
        print(f"{options.ruler}: expected the times of time_optimal_ball.py, {missing} is missing")
        return 2
    times = {kind: read_json(options.ruler / f"ball_{kind}.json") for kind in (*ACTIONS, "chain")}
    rows = []
    for kind in ACTIONS:
        pairs = read_json(options.ruler / f"pairs_{kind}.json")[: len(times[kind])]
        rows.append(row_of(kind, driven(kind, pairs, tools.robot), times[kind]))
    for name, policy in CHAINS.items():
        rows.append(row_of(name, executed(policy, trials, tools, library), times["chain"]))
    command = portable_command("over_ball_ruler", words)
    write_text(options.out, FORMAT.text({"command": command, "seed": SEED, "rows": rows}))
    print(json.dumps(rows, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
