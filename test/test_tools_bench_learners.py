"""Our model tree beside its peers: the comparison is fair and hides nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from experience_rows import made_up_experience
from sklearn.tree import DecisionTreeRegressor

from ator_ros.evaluation.toolset import ToolsetSource
from ator_ros.experience.table import Experience, join, write_experience
from ator_ros.tools.benchmarks import learners, peers
from ator_ros.tools.benchmarks.peer_program import measure
from ator_ros.tools.benchmarks.rows import MeasuredLearner, NotRun, Requirements


@pytest.fixture
def quick(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_environment(folder: Path) -> Path:
        raise peers.NotRunError("installing the peers' packages failed with code 1: no network")

    monkeypatch.setattr(peers, "python_of", no_environment)
    monkeypatch.setattr(peers, "WEKA_JAR", tmp_path / "weka.jar")
    for name in ("HistGradientBoostingRegressor", "RandomForestRegressor"):
        monkeypatch.setattr(learners, name, lambda **_: DecisionTreeRegressor(max_depth=5))


def table(file: Path, seed: int) -> Path:
    frames = [made_up_experience(action, seed=seed) for action in ("goToPose", "dribbleBall")]
    write_experience(file, Experience(join(frames), {"seed": seed}))
    return file


@pytest.mark.usefixtures("quick")
def test_peers_that_cannot_run_say_why_and_the_others_are_compared(tmp_path: Path) -> None:
    tables = {kind: table(tmp_path / f"{kind}.parquet", seed) for kind, seed in learners.SEEDS.items()}
    cases = learners.measure(ToolsetSource(), tables)
    assert len(cases) == 2 * 2 * 8
    row = cases["goToPose, 11 features of the paper: requirements"]
    assert isinstance(row, Requirements)
    assert (row.limit_rmse_over_best_ceiling, row.limit_predict_ms) == (1.15, 0.3)
    assert row.rmse_over_best_ceiling > 0.0
    assert row.times_faster_fit is None
    text = learners.document(cases, 0.25)
    assert "| m5py | not run: installing the peers' packages failed with code 1: no network |" in text
    assert "| Weka M5P | not run: expected java and" in text
    assert "- `times_faster_fit`: not measured" in text
    assert "load when this began was 0.2" in text
    assert text.count("\n## ") == 4


def test_ours_is_compared_with_the_best_of_the_others() -> None:
    def row(rmse: float, fit: float) -> MeasuredLearner:
        return MeasuredLearner(fit_s=fit, predict_ms=0.2, rmse_s=rmse, mae_s=rmse)

    results: learners.Results = {
        "ator_ros": row(0.5, 1.0),
        "m5py": row(0.6, 9.0),
        "linear-tree": row(0.4, 4.0),
        "Weka M5P": NotRun("no java"),
        "HistGradientBoosting": row(0.5, 1.0),
        "RandomForest": row(0.25, 1.0),
    }
    required = learners.requirements(results, 10, 5)
    assert required.rmse_over_best_model_tree == 1.25
    assert required.rmse_over_best_ceiling == 2.0
    assert required.times_faster_fit == 4.0
    assert (required.rows, required.fresh_rows) == (10, 5)
    assert required.limit_fit_75000_rows_s is None
    many = learners.requirements(results, 10, 5, 2.5)
    assert (many.fit_75000_rows_s, many.limit_fit_75000_rows_s) == (2.5, 5.0)


def test_errors_are_those_of_the_rows_held_out() -> None:
    class Constant:
        def fit(self, X: Any, y: Any) -> None:
            pass

        def predict(self, X: Any) -> Any:
            return np.zeros(len(X))

    data = {
        "X": np.zeros((3, 1)),
        "y": np.zeros(3),
        "test_X": np.zeros((2, 1)),
        "test_y": np.array([3.0, -4.0]),
    }
    measured = measure(Constant(), data)
    assert measured["rmse_s"] == pytest.approx(np.sqrt(12.5))
    assert measured["mae_s"] == pytest.approx(3.5)


def test_a_foreign_program_that_fails_says_why(tmp_path: Path) -> None:
    python = tmp_path / "python"
    python.write_text("#!/bin/sh\necho 'no module named m5py' >&2\nexit 3\n")
    python.chmod(0o755)
    with pytest.raises(peers.NotRunError, match="m5py failed with code 3: no module named m5py"):
        peers.run_package("m5py", python, tmp_path / "rows.npz", tmp_path)


def test_a_foreign_program_that_measures_no_number_says_so(tmp_path: Path) -> None:
    python = tmp_path / "python"
    python.write_text('#!/bin/sh\necho \'{"fit_s": 1.0, "rmse_s": Infinity, "mae_s": 1.0}\' > "$4"\n')
    python.chmod(0o755)
    with pytest.raises(peers.NotRunError, match="m5py: rmse_s: expected a finite number; got inf"):
        peers.run_package("m5py", python, tmp_path / "rows.npz", tmp_path)


def test_a_table_that_cannot_be_used_is_said(tmp_path: Path) -> None:
    file = tmp_path / "experience.parquet"
    file.write_text("nothing")
    with pytest.raises(RuntimeError, match="expected a Parquet file"):
        learners.measure(ToolsetSource(), {"experience": file, "fresh": file})
