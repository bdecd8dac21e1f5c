"""Compiled functions and parallel loops: every item once, with identical results."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from ator_ros.compiled import use_cores
from ator_ros.geometry import FloatArray
from ator_ros.performance.driving import plain_driving
from ator_ros.performance.features import PATHS, feature_table
from ator_ros.robot.description import load_robot

WRAP = "from ator_ros.performance.derived import wrapped; print(wrapped(7.0))"


@pytest.mark.long
def test_functions_run_without_a_writable_cache_folder(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    nowhere = str(tmp_path / "file" / "folder")
    environment = {**os.environ, "NUMBA_CACHE_DIR": nowhere, "HOME": nowhere, "XDG_CACHE_HOME": nowhere}
    done = subprocess.run([sys.executable, "-c", WRAP], env=environment, capture_output=True, check=True)
    assert float(done.stdout) == pytest.approx(7.0 - 2.0 * np.pi)


@pytest.fixture(autouse=True)
def one_core_again(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Use four cores, and one again afterwards."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1, 2, 3})
    yield
    use_cores(1)


def results() -> FloatArray:
    rng = np.random.default_rng(23)
    count = 1500
    direct = {name: rng.uniform(-3.0, 3.0, count) for name in ("x", "y", "yaw", "xg", "yg", "yawg")}
    direct |= {"v": rng.uniform(0.0, 1.0, count), "w": np.zeros(count)}
    direct |= {"speedg": rng.uniform(0.0, 0.5, count), "hold": np.ones(count)}
    robot = load_robot()
    return feature_table(direct, robot, PATHS, plain_driving(robot))


def test_results_are_bit_identical_for_any_number_of_threads() -> None:
    alone = results()
    use_cores(3)
    assert results().tobytes() == alone.tobytes()
