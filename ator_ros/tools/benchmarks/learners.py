"""Our model tree beside other model trees and ceilings, on the same rows in one run (paper, section 3).

Learned are the durations of all 10 Hz examples of one table, measured on all of another one.
"""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.ensemble import HistGradientBoostingRegressor, RandomForestRegressor
from sklearn.tree import DecisionTreeRegressor

from ator_ros.domains.domain import find_domain
from ator_ros.evaluation.toolset import ToolsetSource
from ator_ros.experience.errors import ExperienceError
from ator_ros.experience.table import Experience, read_experience
from ator_ros.geometry import FloatArray
from ator_ros.performance.features import PAPER_11, Feature, feature_table, names_of
from ator_ros.performance.training import direct_of
from ator_ros.performance.tree.model_tree import ModelTreeRegressor
from ator_ros.robot.description import Robot
from ator_ros.schema import structured, unstructured
from ator_ros.tools import collect
from ator_ros.tools.benchmarks import peers
from ator_ros.tools.benchmarks.peer_program import measure as measured
from ator_ros.tools.benchmarks.peer_program import predict_ms
from ator_ros.tools.benchmarks.rows import MeasuredLearner, NotRun, Requirements

ACTIONS = 2
"""How many of the domain's actions are learned: the first ones."""
SEEDS = {"experience": 101, "fresh": 211}
OURS = "ator_ros"
MODEL_TREES = ("m5py", "linear-tree", "Weka M5P")
CEILINGS = ("HistGradientBoosting", "RandomForest")
REQUIREMENTS = "requirements"
MANY = 75_000
"""Rows of the fit whose time is limited."""
MANY_ROWS = f"fit_{MANY}_rows_s"
LIMITS = {
    "rmse_over_best_model_tree": 1.0,
    "rmse_over_best_ceiling": 1.15,
    "fit_s": 5.0,
    MANY_ROWS: 5.0,
    "times_faster_fit": 5.0,
    "predict_ms": 0.3,
}
"""Limits: greatest values; of "times_…" least values."""

Results = dict[str, MeasuredLearner | NotRun]
"""By name of the learner."""
Cases = dict[str, MeasuredLearner | NotRun | Requirements]
"""By "SUBJECT: LEARNER" and "SUBJECT: requirements"."""


def measure(
    source: ToolsetSource, tables: Mapping[str, Path], environment: Path = Path(".venv-peers")
) -> Cases:
    """Measure all learners for each action with the paper's and with the shipped features.

    Parameters
    ----------
    source : ToolsetSource
        Domain, actions and robot.
    tables : mapping
        The files of "experience" and "fresh"; collected if they are not there.
    environment : Path
        Folder of the environment of m5py and linear-tree, made if need be.

    Returns
    -------
    Cases
        What was measured of each learner, and how ours compares.
    """
    cases: Cases = {}
    domain, robot = find_domain(source.domain), source.described()
    actions = list(domain.actions(source.action_set))[:ACTIONS]
    experience, fresh = (_table(tables[kind], SEEDS[kind], actions) for kind in SEEDS)
    for action in actions:
        for features, kind in ((PAPER_11, "of the paper"), (domain.candidates(action), "shipped")):
            names = names_of(features)
            subject = f"{action}, {len(names)} features {kind}"
            print(f"bench: learners: {subject}", flush=True)
            X, y, groups = _rows(experience, action, features, robot)
            test_X, test_y, test_groups = _rows(fresh, action, features, robot)
            data = {"X": X, "y": y, "test_X": test_X, "test_y": test_y}
            results = compare(data, groups, names, environment)
            took = _many_rows(data, np.append(groups, test_groups + groups.max() + 1))
            required = requirements(results, len(y), len(test_y), took)
            rows: Cases = {**results, REQUIREMENTS: required}
            cases |= {f"{subject}: {learner}": rounded(row) for learner, row in rows.items()}
    return cases


def compare(
    data: Mapping[str, FloatArray], groups: FloatArray, names: tuple[str, ...], environment: Path
) -> Results:
    """Measure every learner."""
    ours = ModelTreeRegressor()
    whole = structured(measured(ours, data, groups=groups), MeasuredLearner)
    # As the refiner predicts: from the flat arrays.
    quick = predict_ms(ours.tree_.predict, data)
    results: Results = {OURS: dataclasses.replace(whole, predict_ms=quick, leaves=ours.tree_.n_leaves)}
    for name, learner in (
        ("DecisionTree", DecisionTreeRegressor(min_samples_leaf=15, random_state=0)),
        ("HistGradientBoosting", HistGradientBoostingRegressor(random_state=0)),
        ("RandomForest", RandomForestRegressor(n_jobs=-1, random_state=0)),
    ):
        results[name] = structured(measured(learner, data), MeasuredLearner)
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        np.savez(work / "rows.npz", **data)  # type: ignore[arg-type]
        runs: dict[str, Callable[[], MeasuredLearner]] = {
            name: partial(_package, name, environment, work) for name in ("m5py", "linear-tree")
        }
        runs["Weka M5P"] = partial(peers.run_weka, data, names, work)
        for name, run in runs.items():
            try:
                results[name] = run()
            except peers.NotRunError as error:
                results[name] = NotRun(str(error))
    return results


def requirements(
    results: Mapping[str, MeasuredLearner | NotRun], rows: int, fresh_rows: int, many: float | None = None
) -> Requirements:
    """Compare our tree with the model trees that ran and with the ceilings; with the limits.

    `many` is the time in s of a fit of MANY rows.
    """
    ran = {name: row for name, row in results.items() if isinstance(row, MeasuredLearner)}
    ours, trees = ran[OURS], [ran[name] for name in MODEL_TREES if name in ran]
    figures = {
        "rmse_over_best_ceiling": ours.rmse_s / min(ran[name].rmse_s for name in CEILINGS),
        "fit_s": ours.fit_s,
        "predict_ms": ours.predict_ms,
    }
    if trees:
        figures["rmse_over_best_model_tree"] = ours.rmse_s / min(tree.rmse_s for tree in trees)
        figures["times_faster_fit"] = min(tree.fit_s for tree in trees) / ours.fit_s
    if many is not None:
        figures[MANY_ROWS] = many
    limits = {f"limit_{name}": LIMITS[name] for name in figures}
    return structured({**figures, **limits, "rows": rows, "fresh_rows": fresh_rows}, Requirements)


def _many_rows(data: Mapping[str, FloatArray], groups: FloatArray) -> float | None:
    """Return the time in s of our fit of MANY rows of both tables; None where there are fewer."""
    X, y = (np.concatenate([data[name], data[f"test_{name}"]])[:MANY] for name in ("X", "y"))
    if len(y) < MANY:
        return None
    few = {"X": X, "y": y, "test_X": data["test_X"][:1000], "test_y": data["test_y"][:1000]}
    return structured(measured(ModelTreeRegressor(), few, groups=groups[:MANY]), MeasuredLearner).fit_s


def _package(name: str, environment: Path, work: Path) -> MeasuredLearner:
    return peers.run_package(name, peers.python_of(environment), work / "rows.npz", work)


def _table(file: Path, seed: int, actions: Sequence[str]) -> Experience:
    """Read a table of experience; collect it if it is not there."""
    if not file.exists():
        print(f"bench: {file} is not there: collecting it takes minutes, once", flush=True)
        words = ["--actions", *actions, "--seed", str(seed), "--out", str(file)]
        if collect.main(words):
            raise RuntimeError(f"{file}: expected `collect` to make it; see above")
    try:
        return read_experience(file)
    except ExperienceError as error:
        raise RuntimeError(str(error)) from error


def _rows(
    experience: Experience, action: str, features: tuple[Feature, ...], robot: Robot
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return features, times to go and episodes of all examples of episodes of `action` that succeeded."""
    frame = experience.of(action)
    frame = frame[frame["success"]]
    X = np.ascontiguousarray(feature_table(direct_of(frame), robot, features))
    return X, frame["time_to_go"].to_numpy(dtype=float), frame["episode"].to_numpy()


def rounded(row: MeasuredLearner | NotRun | Requirements) -> MeasuredLearner | NotRun | Requirements:
    """Return a row rounded to the four digits that a table shows."""
    figures = unstructured(row).items()
    shown: dict[str, Any] = {name: float(f"{v:.4g}") for name, v in figures if isinstance(v, float)}
    return dataclasses.replace(row, **shown)


def document(cases: Cases, load: float) -> str:
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
    learners: dict[str, Results] = {}
    for case, row in cases.items():
        subject, _, learner = case.rpartition(": ")
        if not isinstance(row, Requirements):
            learners.setdefault(subject, {})[learner] = row
            continue
        lines += ["", f"## {subject}", "", f"{row.rows} rows, {row.fresh_rows} fresh ones.", ""]
        lines += [*_learner_table(learners[subject]), "", *_requirement_list(row)]
    return "\n".join(lines) + "\n"


def _learner_table(rows: Results) -> Iterator[str]:
    yield "| learner | fit (s) | predict 360 (ms) | RMSE (s) | MAE (s) | leaves |"
    yield "| --- | ---: | ---: | ---: | ---: | ---: |"
    for name, row in rows.items():
        if isinstance(row, NotRun):
            yield f"| {name} | not run: {row.not_run} | | | | |"
            continue
        predict = "" if row.predict_ms is None else f"{row.predict_ms:.2f}"
        numbers = f"{row.fit_s:.2f} | {predict} | {row.rmse_s:.3f} | {row.mae_s:.3f}"
        label = name if row.version is None else f"{name} {row.version}"
        yield f"| {label} | {numbers} | {'' if row.leaves is None else row.leaves} |"


def _requirement_list(row: Requirements) -> Iterator[str]:
    for name, limit in LIMITS.items():
        value = getattr(row, name)
        if value is None:
            yield f"- `{name}`: not measured"
            continue
        least = name.startswith("times_")
        holds = value >= limit if least else value <= limit
        words = f"{'at least' if least else 'at most'} {limit:g}"
        yield f"- `{name}` {value:.3g}, {words}: {'holds' if holds else 'DOES NOT HOLD'}"
