"""The comparison with peers: it is fair, and hides nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks import foreign, peers
from benchmarks.measure import measure
from benchmarks.rows import Rows, split


@pytest.fixture
def rows() -> Rows:
    rng = np.random.default_rng(1)
    groups = np.repeat(np.arange(40), 10)
    X = rng.uniform(0, 1, size=(400, 2))
    return Rows(X, np.abs(X[:, 0] - 0.5) + rng.normal(0, 0.01, 400), groups, ("dist", "angle"))


def test_episodes_are_held_out_whole_and_nothing_is_lost(rows):
    train, test = split(rows, test_share=0.25, seed=0)
    assert len(np.unique(test.groups)) == 10
    assert not set(train.groups) & set(test.groups)
    assert len(train.y) + len(test.y) == 400


def test_errors_are_those_of_the_rows_held_out():
    class Constant:
        def fit(self, X, y):
            return self

        def predict(self, X):
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


def test_a_peer_that_cannot_run_stays_in_the_table_and_decides_nothing(rows, tmp_path, monkeypatch):
    def no_environment(folder: Path) -> Path:
        raise foreign.NotRunError("the peers' packages failed with code 1: no network")

    monkeypatch.setattr(peers, "peers_python", no_environment)
    monkeypatch.setattr(foreign, "WEKA_JAR", tmp_path / "weka.jar")
    train, test = split(rows, test_share=0.25, seed=0)
    results = peers.compare(train, test, tmp_path, timeout_s=1.0)
    text = peers.table(results)
    assert "| m5py | not run: the peers' packages failed with code 1: no network |" in text
    assert "| Weka M5P | not run: expected java and" in text
    checks = peers.verdicts(results)
    assert checks["RMSE no worse than any other model tree"] is None
    assert "fit in at most 5 s" in checks


def test_a_foreign_program_that_fails_says_why(tmp_path):
    (tmp_path / "bin").mkdir()
    python = tmp_path / "bin" / "python"
    python.write_text("#!/bin/sh\necho 'no module named m5py' >&2\nexit 3\n")
    python.chmod(0o755)
    with pytest.raises(foreign.NotRunError, match="m5py failed with code 3: no module named m5py"):
        foreign.run_peer("m5py", python, tmp_path / "rows.npz", tmp_path, timeout_s=5.0)
