"""Compare the model tree with learners of scikit-learn on the same examples (paper, section 3).

    ros2 run ator_ros collect --seed 101 --out experience.parquet
    ros2 run ator_ros collect --seed 211 --out fresh.parquet
    scripts/run python benchmarks/learners.py experience.parquet fresh.parquet

All learn the durations of the episodes in the first table and are measured on the second.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.ensemble import HistGradientBoostingRegressor, RandomForestRegressor
from sklearn.tree import DecisionTreeRegressor

from ator_ros.bases.description import Robot
from ator_ros.bases.interface import Driving
from ator_ros.domains.domain import find_domain
from ator_ros.experience.table import Experience, read_experience
from ator_ros.geometry import FloatArray
from ator_ros.performance.features import PAPER_11, Feature, feature_table
from ator_ros.performance.training import direct_of
from ator_ros.performance.tree.model_tree import ModelTreeRegressor

CANDIDATES = 360
"""Rows whose prediction is timed: one for each degree of a heading."""
OTHERS: dict[str, Callable[[], Any]] = {
    "DecisionTree": lambda: DecisionTreeRegressor(min_samples_leaf=15, random_state=0),
    "HistGradientBoosting": lambda: HistGradientBoostingRegressor(random_state=0),
    "RandomForest": lambda: RandomForestRegressor(n_jobs=-1, random_state=0),
}


def examples(
    experience: Experience,
    action: str,
    features: tuple[Feature, ...],
    robot: Robot,
    driving: Driving,
) -> tuple[FloatArray, FloatArray]:
    """Return features and durations (s) of an action's episodes that succeeded."""
    frame = experience.of(action)
    frame = frame[frame["success"] & (frame["t"] == 0.0)]
    X = np.ascontiguousarray(feature_table(direct_of(frame), robot, features, driving))
    return X, frame["duration"].to_numpy(dtype=float)


def _predicted(tree: ModelTreeRegressor, rows: FloatArray) -> FloatArray:
    """Return the predictions by the refiner's fast path."""
    return tree.tree_.predict(rows)


def measured(
    learner: Any,
    predict: Callable[[Any], Any],
    fit: Callable[[], Any],
    test: Any,
    y: Any,
) -> str:
    """Fit a learner; return its times and errors as cells of a table.

    `test` and `y` are the fresh features, shape (n, n_features), and durations (s), shape (n,).
    """
    began = time.perf_counter()
    fit()
    fitted = time.perf_counter() - began
    error = np.asarray(learner.predict(test)).ravel() - y
    few = np.ascontiguousarray(test[:CANDIDATES])
    times = []
    for _ in range(21):
        began = time.perf_counter()
        predict(few)
        times.append(time.perf_counter() - began)
    rmse = float(np.sqrt(np.mean(error**2)))
    mae = float(np.mean(np.abs(error)))
    return f"{fitted:.2f} | {1000.0 * float(np.median(times)):.2f} | {rmse:.3f} | {mae:.3f}"


def main(argv: Sequence[str] | None = None) -> int:
    """Print a table for each action, with the paper's features and with those that ship."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("experience", type=Path, help="table of collect, to learn from")
    parser.add_argument("fresh", type=Path, help="another one, to measure on")
    options = parser.parse_args(argv)
    domain = find_domain()
    robot = domain.robot()
    experience = read_experience(options.experience)
    fresh = read_experience(options.fresh)
    for action in experience.frame["action"].unique():
        driving = robot.observed_driving(experience.of(action))
        for features, kind in ((PAPER_11, "of the paper"), (domain.candidates(action), "shipped")):
            X, y = examples(experience, action, features, robot, driving)
            test, test_y = examples(fresh, action, features, robot, driving)
            print(
                f"\n{action}, {len(features)} features {kind}, {len(y)} episodes, "
                f"{len(test_y)} fresh\n"
            )
            print("| learner | fit (s) | predict 360 (ms) | RMSE (s) | MAE (s) |")
            print("|---|---|---|---|---|")
            tree = ModelTreeRegressor()
            row = measured(
                tree,
                partial(_predicted, tree),
                partial(tree.fit, X, y),
                test,
                test_y,
            )
            print(f"| ator_ros | {row} |")
            for name, make in OTHERS.items():
                other = make()
                row = measured(
                    other,
                    other.predict,
                    partial(other.fit, X, y),
                    test,
                    test_y,
                )
                print(f"| {name} | {row} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
