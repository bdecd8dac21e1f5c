"""Compiled functions, and loops that several cores share: every item once, the same results."""

from __future__ import annotations

import copy
import os
import pickle
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from ator_ros.compiled import in_shares, use_cores
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.run_up_times import run_up_times
from ator_ros.geometry import FloatArray
from ator_ros.performance.derived import wrapped
from ator_ros.performance.features import feature_table
from ator_ros.robot.description import load_robot

WRAP = "from ator_ros.performance.derived import wrapped; print(wrapped(7.0))"


def test_a_compiled_function_is_found_by_its_name_in_another_process() -> None:
    assert pickle.loads(pickle.dumps(wrapped)) is wrapped  # noqa: S301
    assert copy.deepcopy(wrapped) is wrapped


@pytest.mark.long
def test_functions_run_where_no_folder_takes_machine_code(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    nowhere = str(tmp_path / "file" / "folder")
    environment = {**os.environ, "NUMBA_CACHE_DIR": nowhere, "HOME": nowhere, "XDG_CACHE_HOME": nowhere}
    done = subprocess.run([sys.executable, "-c", WRAP], env=environment, capture_output=True, check=True)
    assert float(done.stdout) == pytest.approx(7.0 - 2.0 * np.pi)


@pytest.fixture(autouse=True)
def one_core_again(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Pretend that there are four cores, and use one again in the end."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1, 2, 3})
    yield
    use_cores(1)


@pytest.mark.parametrize("most", [1, 2, 3])
@pytest.mark.parametrize(("count", "least"), [(0, 5), (5, 5), (6, 5), (1000, 7)])
def test_every_item_is_computed_once(most: int, count: int, least: int) -> None:
    assert use_cores(most) == most
    done: list[int] = []
    in_shares(lambda first, end: done.extend(range(first, end)), count, least)
    assert sorted(done) == list(range(count))


@pytest.mark.parametrize("failing", [0, 60])
def test_an_error_is_raised_wherever_it_happens(failing: int) -> None:
    use_cores(2)

    def run(first: int, end: int) -> None:
        time.sleep(0.01)
        if first == failing:
            raise ArithmeticError(f"share {first}")

    with pytest.raises(ArithmeticError, match=f"share {failing}"):
        in_shares(run, 180, 60)


def results() -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(23)
    count = 1500
    direct = {name: rng.uniform(-3.0, 3.0, count) for name in ("x", "y", "yaw", "xg", "yg", "yawg")}
    direct |= {"v": rng.uniform(0.0, 1.0, count), "w": np.zeros(count)}
    direct |= {"speedg": rng.uniform(0.0, 0.5, count), "hold": np.ones(count)}
    names = ["drive_time", "drive_turn", "dribble_time", "dribble_turn", "path_time"]
    table = feature_table(direct, load_robot(), [SOCCER.known_features[name] for name in names])
    starts = np.stack(
        [rng.uniform(-4.0, -1.0, count), *rng.uniform(-2.0, 2.0, (2, count)), 0.5 + 0.0 * direct["v"]]
    )
    return table, run_up_times(load_robot(), starts)


def test_results_are_the_same_to_the_bit_however_they_are_shared() -> None:
    alone = results()
    use_cores(3)
    for one, shared in zip(alone, results(), strict=True):
        assert one.tobytes() == shared.tobytes()
