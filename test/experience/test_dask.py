"""Collection and evaluation on a dask cluster: a LocalCluster here, the same options for a real one."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import distributed
import pandas as pd
import pytest
from experience_rows import synthetic_model

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.experience.parallel import BackendError, workers
from ator_ros.experience.table import read_experience
from ator_ros.files import read_json
from ator_ros.performance.model_file import save_model
from ator_ros.robot.description import load_robot
from ator_ros.tools import collect, evaluate


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as local:
        yield local.scheduler_address


def on(address: str) -> list[str]:
    return ["--cluster", address]


@pytest.mark.long
def test_collect_gives_the_same_table(address: str, tmp_path: Path) -> None:
    tables = []
    for name, words in {"here": ["--jobs", "1"], "there": on(address)}.items():
        file = tmp_path / f"{name}.parquet"
        assert collect.main(["--episodes", "1", "--seed", "9", "--out", str(file), *words]) == 0
        tables.append(read_experience(file).frame)
    assert set(tables[0]["action"]) == {"goToPose", "dribbleBall", "shoot"}
    pd.testing.assert_frame_equal(*tables, check_exact=True)


@pytest.mark.long
def test_evaluate_gives_the_same_runs(address: str, tmp_path: Path) -> None:
    models = tmp_path / "models"
    for action in SOCCER.actions():
        save_model(models / f"{action}.json", synthetic_model(action, load_robot()))
    given = ["--situations", "2", "--seed", "405", "--policies", "naive", "refined"]
    runs = []
    for name, words in {"here": ["--jobs", "1"], "there": on(address)}.items():
        folder = tmp_path / name
        assert evaluate.main([*given, "--models", str(models), "--out", str(folder), *words]) == 0
        runs.append(read_json(folder / "evaluation.json")["runs"])
    assert runs[0] == runs[1]


def test_an_invalid_address_is_rejected() -> None:
    expected = "cluster: expected a dask scheduler as in tcp://host:8786, got 'nowhere'"
    with pytest.raises(BackendError, match=expected), workers(2, "nowhere"):
        pass
