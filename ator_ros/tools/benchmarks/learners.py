"""Our model tree beside other model trees and ceilings, on the same rows in one run (paper, section 3).

Learned are the durations of all 10 Hz examples of one table, measured on all of another one.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.ensemble import HistGradientBoostingRegressor, RandomForestRegressor
from sklearn.tree import DecisionTreeRegressor

from ator_ros.domains.domain import find_domain
from ator_ros.experience.errors import ExperienceError
from ator_ros.experience.table import Experience, read_experience
from ator_ros.geometry import FloatArray
from ator_ros.performance.features import PAPER_11, Feature, feature_table, names_of
from ator_ros.performance.training import direct_of
from ator_ros.performance.tree.model_tree import ModelTreeRegressor
from ator_ros.robot.description import load_robot
from ator_ros.tools import collect
from ator_ros.tools.benchmarks import peers
from ator_ros.tools.benchmarks.peer_program import measure as measured
from ator_ros.tools.benchmarks.peer_program import predict_ms

DOMAIN = find_domain()
ACTIONS = tuple(DOMAIN.actions())[:2]
SEEDS = {"experience": 101, "fresh": 211}
OURS = "ator_ros"
MODEL_TREES = ("m5py", "linear-tree", "Weka M5P")
CEILINGS = ("HistGradientBoosting", "RandomForest")
REQUIREMENTS = "requirements"
MANY = 75_000
"""Rows of the fit whose time is limited."""
LIMITS = {
    "rmse_over_best_model_tree": 1.0,
    "rmse_over_best_ceiling": 1.15,
    "fit_s": 5.0,
    f"fit_{MANY}_rows_s": 5.0,
    "times_faster_fit": 5.0,
    "predict_ms": 0.3,
}
"""Limits: greatest values; of "times_…" least values."""

Row = dict[str, Any]


def measure(tables: Mapping[str, Path], environment: Path = Path(".venv-peers")) -> dict[str, Row]:
    """Measure all learners for each action with the paper's and with the shipped features.

    Parameters
    ----------
    tables : mapping
        The files of "experience" and "fresh"; collected if they are not there.
    environment : Path
        Folder of the environment of m5py and linear-tree, made if need be.

    Returns
    -------
    dict
        By "SUBJECT: LEARNER" what was measured, by "SUBJECT: requirements" how ours compares. A learner that
        cannot run has `not_run` with the reason.
    """
    cases: dict[str, Row] = {}
    experience, fresh = (_table(tables[kind], SEEDS[kind]) for kind in SEEDS)
    for action in ACTIONS:
        for features, kind in (
            (PAPER_11, "of the paper"),
            (DOMAIN.candidates(action), "shipped"),
        ):
            names = names_of(features)
            subject = f"{action}, {len(names)} features {kind}"
            print(f"bench: learners: {subject}", flush=True)
            X, y, groups = _rows(experience, action, features)
            test_X, test_y, test_groups = _rows(fresh, action, features)
            data = {"X": X, "y": y, "test_X": test_X, "test_y": test_y}
            results = compare(data, groups, names, environment)
            results[REQUIREMENTS] |= _many_rows(data, np.append(groups, test_groups + groups.max() + 1))
            results[REQUIREMENTS] |= {"rows": len(y), "fresh_rows": len(test_y)}
            cases |= {f"{subject}: {learner}": row for learner, row in results.items()}
    return cases


def compare(
    data: Mapping[str, FloatArray], groups: FloatArray, names: tuple[str, ...], environment: Path
) -> dict[str, Row]:
    """Measure every learner; one that cannot run has `not_run` with the reason."""
    ours = ModelTreeRegressor()
    results = {OURS: measured(ours, data, groups=groups)}
    # As the refiner predicts: from the flat arrays.
    results[OURS] |= {"predict_ms": predict_ms(ours.tree_.predict, data), "leaves": ours.tree_.n_leaves}
    for name, learner in (
        ("DecisionTree", DecisionTreeRegressor(min_samples_leaf=15, random_state=0)),
        ("HistGradientBoosting", HistGradientBoostingRegressor(random_state=0)),
        ("RandomForest", RandomForestRegressor(n_jobs=-1, random_state=0)),
    ):
        results[name] = measured(learner, data)
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        np.savez(work / "rows.npz", **data)  # type: ignore[arg-type]
        runs: dict[str, Callable[[], Row]] = {
            name: partial(_package, name, environment, work) for name in ("m5py", "linear-tree")
        }
        runs["Weka M5P"] = partial(peers.run_weka, data, names, work)
        for name, run in runs.items():
            try:
                results[name] = run()
            except peers.NotRunError as error:
                results[name] = {"not_run": str(error)}
    rounded = {name: {key: _rounded(value) for key, value in row.items()} for name, row in results.items()}
    return {**rounded, REQUIREMENTS: requirements(results)}


def requirements(results: Mapping[str, Row]) -> Row:
    """Compare our tree with the model trees that ran and with the ceilings; with the limits."""
    ours = results[OURS]
    trees = [results[name] for name in MODEL_TREES if "not_run" not in results[name]]
    row = {
        "rmse_over_best_ceiling": ours["rmse_s"] / min(results[name]["rmse_s"] for name in CEILINGS),
        "fit_s": ours["fit_s"],
        "predict_ms": ours["predict_ms"],
    }
    if trees:
        row["rmse_over_best_model_tree"] = ours["rmse_s"] / min(tree["rmse_s"] for tree in trees)
        row["times_faster_fit"] = min(tree["fit_s"] for tree in trees) / ours["fit_s"]
    limits = {f"limit_{name}": LIMITS[name] for name in row}
    return {name: _rounded(value) for name, value in row.items()} | limits


def _many_rows(data: Mapping[str, FloatArray], groups: FloatArray) -> Row:
    """Time our fit of 75,000 rows of both tables; nothing where there are fewer."""
    X, y = (np.concatenate([data[name], data[f"test_{name}"]])[:MANY] for name in ("X", "y"))
    if len(y) < MANY:
        return {}
    few = {"X": X, "y": y, "test_X": data["test_X"][:1000], "test_y": data["test_y"][:1000]}
    name = f"fit_{MANY}_rows_s"
    took = measured(ModelTreeRegressor(), few, groups=groups[:MANY])["fit_s"]
    return {name: _rounded(took), f"limit_{name}": LIMITS[name]}


def _package(name: str, environment: Path, work: Path) -> Row:
    return peers.run_package(name, peers.python_of(environment), work / "rows.npz", work)


def _table(file: Path, seed: int) -> Experience:
    """Read a table of experience; collect it if it is not there."""
    if not file.exists():
        print(f"bench: {file} is not there: collecting it takes minutes, once", flush=True)
        words = ["--actions", *ACTIONS, "--seed", str(seed), "--out", str(file)]
        if collect.main(words):
            raise RuntimeError(f"{file}: expected `collect` to make it; see above")
    try:
        return read_experience(file)
    except ExperienceError as error:
        raise RuntimeError(str(error)) from error


def _rows(
    experience: Experience, action: str, features: tuple[Feature, ...]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return features, times to go and episodes of all examples of episodes of `action` that succeeded."""
    frame = experience.of(action)
    frame = frame[frame["success"]]
    X = np.ascontiguousarray(feature_table(direct_of(frame), load_robot(), features))
    return X, frame["time_to_go"].to_numpy(dtype=float), frame["episode"].to_numpy()


def _rounded(value: Any) -> Any:
    """Round to the four digits that a table shows."""
    return float(f"{value:.4g}") if isinstance(value, float) else value


def document(cases: Mapping[str, Row], load: float) -> str:
    """Write the result of `measure` as Markdown; `load` is that of the machine when it began."""
    lines = [
        "# The model tree beside its peers",
        "",
        "Made by `make bench` (part `learners`), every table in one run on the same rows: all 10 Hz examples",
        f"of `collect --seed {SEEDS['experience']}` to learn and of `collect --seed {SEEDS['fresh']}` to",
        "measure. m5py and linear-tree run in an environment of their own with scikit-learn 1.3.2, Weka from",
        "Debian's package; all with their defaults (linear-tree: depth 8). Weka tells no time of prediction.",
        "Ours alone is told which rows are of one episode (`groups`), to keep them together when it prunes.",
        f"The machine's load when this began was {load:.1f}: times hold for an idle machine, near 0.",
    ]
    subjects: dict[str, dict[str, Row]] = {}
    for case, row in cases.items():
        subject, _, learner = case.rpartition(": ")
        subjects.setdefault(subject, {})[learner] = row
    for subject, rows in subjects.items():
        ours = rows.pop(REQUIREMENTS)
        lines += ["", f"## {subject}", "", f"{ours['rows']} rows, {ours['fresh_rows']} fresh ones.", ""]
        lines += [*_learner_table(rows), "", *_requirement_list(ours)]
    return "\n".join(lines) + "\n"


def _learner_table(rows: Mapping[str, Row]) -> Iterator[str]:
    yield "| learner | fit (s) | predict 360 (ms) | RMSE (s) | MAE (s) | leaves |"
    yield "| --- | ---: | ---: | ---: | ---: | ---: |"
    for name, row in rows.items():
        if "not_run" in row:
            yield f"| {name} | not run: {row['not_run']} | | | | |"
            continue
        predict = f"{row['predict_ms']:.2f}" if "predict_ms" in row else ""
        numbers = f"{row['fit_s']:.2f} | {predict} | {row['rmse_s']:.3f} | {row['mae_s']:.3f}"
        label = f"{name} {row['version']}" if "version" in row else name
        yield f"| {label} | {numbers} | {row.get('leaves', '')} |"


def _requirement_list(row: Row) -> Iterator[str]:
    for name, limit in LIMITS.items():
        if name in row:
            least = name.startswith("times_")
            holds = row[name] >= limit if least else row[name] <= limit
            words = f"{'at least' if least else 'at most'} {limit:g}"
            yield f"- `{name}` {row[name]:.3g}, {words}: {'holds' if holds else 'DOES NOT HOLD'}"
        else:
            yield f"- `{name}`: not measured"
