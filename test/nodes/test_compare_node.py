"""Chains take as long over ROS as in the tools."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix

from ator_ros.files import read_json
from ator_ros.schema import structured
from ator_ros.tools.work.comparison import FORMAT, Compared, ComparisonResult, comparison


@pytest.mark.node
@pytest.mark.long
def test_faster_than_real_time_the_nodes_drive_as_the_tools_do(tmp_path: Path) -> None:
    compare = Path(get_package_prefix("ator_ros"), "lib", "ator_ros", "compare")
    out = tmp_path / "compare.json"
    words = ["--situations", "2", "--real-time-factor", "10", "--out", str(out)]
    ended = subprocess.run([str(compare), *words], capture_output=True, text=True, check=False, timeout=200)
    assert ended.returncode == 0, ended.stdout[-2000:] + ended.stderr
    report = structured(FORMAT.content(read_json(out)), ComparisonResult, closed=True)
    assert report.situations == report.same_to_the_tick == 2
    assert report.met
    assert report.prediction is not None
    assert report.prediction.chains == len(report.prediction.errors_s) == 2
    assert report.prediction.mae_s is not None
    assert report.prediction.mae_s < 1.0


def compared(*runs: Compared) -> ComparisonResult:
    return comparison(
        runs, command="compare", seed=1, real_time_factor=1.0, chains=["dribble"], policies=["naive"]
    )


def test_means_that_are_apart_are_told() -> None:
    told = compared(Compared(10.0, 10.0), Compared(11.0, 10.0))
    assert told.difference_percent == pytest.approx(5.0)
    assert told.same_to_the_tick == 1
    assert not told.met
    assert told.prediction is not None
    assert (told.prediction.chains, told.prediction.mean_error_s) == (0, None)


def test_predictions_are_compared_with_what_the_nodes_drove() -> None:
    told = compared(
        Compared(10.0, 10.0, 9.8),
        Compared(11.0, 10.0, 11.1),
        Compared(30.0, 9.0),  # as of a chain that failed
        Compared(8.0, 8.0),
    ).prediction  # without the chain that failed, and the one that was not predicted
    assert told is not None
    assert told.errors_s == (-0.2, 0.1)
    assert told.chains == 2
    assert told.mean_error_s == pytest.approx(-0.05)
