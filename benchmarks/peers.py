"""Compare our model tree with other model trees and with ceilings, on the same rows in one run.

From a checkout: ``python -m benchmarks.peers experience.parquet --out peers.json``. The peers m5py and
linear-tree get an environment of their own, Weka's M5P is Debian's package ``weka``; a peer that can't run
stays in the table with the reason.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.ensemble import HistGradientBoostingRegressor, RandomForestRegressor
from sklearn.tree import DecisionTreeRegressor

from ator_ros.experience.table import library_versions
from ator_ros.performance.features import PAPER_11, SIGNED, names_of
from ator_ros.performance.model_tree import ModelTreeRegressor
from ator_ros.robot import load_robot
from benchmarks.foreign import NotRunError, peers_python, run_peer, run_weka
from benchmarks.measure import CANDIDATES, measure, median_time
from benchmarks.rows import Rows, load_rows, split

OURS = "ator_ros"
MODEL_TREES = ("m5py", "linear-tree", "Weka M5P")
CEILINGS = ("HistGradientBoosting", "RandomForest")
FEATURES = {"paper": names_of(PAPER_11), "signed": names_of((*PAPER_11, *SIGNED))}


def compare(train: Rows, test: Rows, environment: Path, *, timeout_s: float) -> dict[str, dict[str, Any]]:
    """Measure every learner; by name, the measures or ``error`` with the reason why there are none."""
    data = {"X": train.X, "y": train.y, "test_X": test.X, "test_y": test.y}
    results = {OURS: _ours(train, data)}
    for name, learner in (
        ("DecisionTree", DecisionTreeRegressor(min_samples_leaf=15, random_state=0)),
        ("HistGradientBoosting", HistGradientBoostingRegressor(random_state=0)),
        ("RandomForest", RandomForestRegressor(n_jobs=-1, random_state=0)),
    ):
        results[name] = measure(learner, data)
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        table = work / "rows.npz"
        np.savez(table, X=train.X, y=train.y, test_X=test.X, test_y=test.y)
        runs: dict[str, Callable[[], dict[str, Any]]] = {
            "m5py": lambda: run_peer("m5py", peers_python(environment), table, work, timeout_s=timeout_s),
            "linear-tree": lambda: run_peer(
                "linear-tree", peers_python(environment), table, work, timeout_s=timeout_s
            ),
            "Weka M5P": lambda: run_weka(data, train.names, work, timeout_s=timeout_s),
        }
        for name, run in runs.items():
            try:
                results[name] = run()
            except NotRunError as error:
                results[name] = {"error": str(error)}
    return results


def _ours(train: Rows, data: dict[str, Any]) -> dict[str, Any]:
    """Measure our tree; predictions are timed as the refiner makes them, from the flat arrays."""
    learner = ModelTreeRegressor()
    measured = measure(learner, data, groups=train.groups)
    candidates = np.ascontiguousarray(data["test_X"][:CANDIDATES])
    measured["predict_ms"] = 1e3 * median_time(learner.tree_.predict, candidates)
    return {**measured, "leaves": learner.tree_.n_leaves}


def verdicts(results: dict[str, dict[str, Any]]) -> dict[str, bool | None]:
    """Tell which requirements hold; None where a peer that decides it did not run."""
    ours = results[OURS]
    trees = [results[name] for name in MODEL_TREES]
    all_ran = all("error" not in tree for tree in trees)
    ceiling = min(results[name]["rmse_s"] for name in CEILINGS)
    return {
        "RMSE no worse than any other model tree": (
            all(ours["rmse_s"] <= tree["rmse_s"] for tree in trees) if all_ran else None
        ),
        "RMSE within 15 % of the best ceiling": ours["rmse_s"] <= 1.15 * ceiling,
        "fit in at most 5 s": ours["fit_s"] <= 5.0,
        "fit at least 5 times faster than any other model tree": (
            all(5 * ours["fit_s"] <= tree["fit_s"] for tree in trees) if all_ran else None
        ),
        f"{CANDIDATES} candidates in at most 0.3 ms": ours["predict_ms"] <= 0.3,
    }


def table(results: dict[str, dict[str, Any]]) -> str:
    """Write the results as a table in Markdown."""
    lines = [f"| learner | fit [s] | predict {CANDIDATES} [ms] | RMSE [s] | MAE [s] | leaves |"]
    lines.append("| --- | ---: | ---: | ---: | ---: | ---: |")
    for name, result in results.items():
        if "error" in result:
            lines.append(f"| {name} | not run: {result['error']} | | | | |")
            continue
        predict = "" if result["predict_ms"] is None else f"{result['predict_ms']:.2f}"
        label = f"{name} {result['version']}" if "version" in result else name
        numbers = f"{result['fit_s']:.2f} | {predict} | {result['rmse_s']:.3f} | {result['mae_s']:.3f}"
        lines.append(f"| {label} | {numbers} | {result.get('leaves', '')} |")
    return "\n".join(lines)


def arguments() -> argparse.ArgumentParser:
    """Give the command line."""
    parser = argparse.ArgumentParser(prog="peers", description=__doc__)
    parser.add_argument("experience", type=Path, help="table that `collect` wrote")
    parser.add_argument("--actions", nargs="+", default=["goToPose", "dribbleBall"])
    parser.add_argument("--features", choices=list(FEATURES), default="paper", help="the paper's 11, or more")
    parser.add_argument("--test-share", type=float, default=0.25, help="share of episodes held out")
    parser.add_argument("--seed", type=int, default=0, help="of the choice of these episodes")
    parser.add_argument(
        "--environment", type=Path, default=Path(".venv-peers"), help="of m5py and linear-tree"
    )
    parser.add_argument("--timeout", type=float, default=600.0, help="in s, for each peer")
    parser.add_argument("--out", type=Path, help="write the results there as JSON")
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; give the exit code."""
    options = arguments().parse_args(argv)
    report: dict[str, Any] = {"versions": library_versions(), "cores": os.cpu_count(), "seed": options.seed}
    for action in options.actions:
        rows = load_rows(options.experience, action, load_robot(), FEATURES[options.features])
        train, test = split(rows, test_share=options.test_share, seed=options.seed)
        results = compare(train, test, options.environment, timeout_s=options.timeout)
        checks = verdicts(results)
        report[action] = {"rows": len(train.y), "test_rows": len(test.y), "features": list(rows.names)}
        report[action] |= {"learners": results, "requirements": checks}
        words = {True: "yes", False: "NO", None: "unknown, a peer did not run"}
        print(f"\n{action}: {len(train.y)} rows of {len(rows.names)} features, {len(test.y)} held out\n")
        print(table(results) + "\n\n" + "\n".join(f"- {name}: {words[ok]}" for name, ok in checks.items()))
    if options.out is not None:
        temporary = options.out.with_name(f".{options.out.name}.tmp")
        temporary.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
        os.replace(temporary, options.out)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
