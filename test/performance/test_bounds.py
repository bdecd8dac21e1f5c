"""Compiled code accesses no memory beyond its arrays, and runs without a cache folder."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ator_ros.bases.description import load_robot
from ator_ros.bases.differential.turns import look_up
from ator_ros.bases.direct import DIRECT_VARIABLES
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.performance.features import feature_table

EDGES = [0.0, 1e-300, 1e-9, 0.01, 0.5, 1.0, 3.14159265358979, 7.0, 100.0, 1e4, 1e6]
"""Numbers that files, messages and command lines may contain, up to their checked bounds."""
CHECKED = ("performance", "refinement/test_refinement_search.py", "domains/test_shoot.py")
"""Tests that run compiled code."""


def extremes(count: int) -> dict[str, np.ndarray]:
    """Return situations with numbers at the limits of accepted values, of either sign."""
    rng = np.random.default_rng(17)
    signed = [sign * edge for sign in (1.0, -1.0) for edge in EDGES]
    situations = {name: rng.choice(signed, count) for name in DIRECT_VARIABLES}
    situations["speedg"] = np.abs(situations["speedg"])
    situations["hold"] = rng.integers(0, 2, count).astype(float)
    return situations


def test_extreme_situations_give_features() -> None:
    features = SOCCER.known_features
    table = feature_table(extremes(500), load_robot(), list(features.values()))
    assert table.shape == (500, len(features))


@pytest.mark.skipif(
    os.environ.get("NUMBA_BOUNDSCHECK") != "1", reason="only with NUMBA_BOUNDSCHECK=1"
)
def test_an_index_beyond_an_array_raises() -> None:
    with pytest.raises(IndexError):
        look_up(np.zeros(3), 7, 0.5)


@pytest.mark.long
def test_compiled_code_stays_within_its_arrays() -> None:
    folder = Path(__file__).parents[1]
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "-m",
        "not long and not node",
    ]
    done = subprocess.run(
        [*command, *(str(folder / name) for name in CHECKED)],
        cwd=folder.parent,
        env={**os.environ, "NUMBA_BOUNDSCHECK": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-5000:]


WRAP = "from ator_ros.bases.direct import wrapped; print(wrapped(7.0))"


@pytest.mark.long
def test_functions_run_without_a_writable_cache_folder(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    nowhere = str(tmp_path / "file" / "folder")
    environment = {
        **os.environ,
        "NUMBA_CACHE_DIR": nowhere,
        "HOME": nowhere,
        "XDG_CACHE_HOME": nowhere,
    }
    done = subprocess.run(
        [sys.executable, "-c", WRAP], env=environment, capture_output=True, check=True
    )
    assert float(done.stdout) == pytest.approx(7.0 - 2.0 * np.pi)
