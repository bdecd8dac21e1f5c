"""Chains take as long over ROS as in the tools."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix

from ator_ros.tools.work.compare import Compared, prediction_summary, summary


@pytest.mark.node
@pytest.mark.long
def test_faster_than_real_time_the_nodes_drive_as_the_tools_do(tmp_path: Path) -> None:
    compare = Path(get_package_prefix("ator_ros"), "lib", "ator_ros", "compare")
    out = tmp_path / "compare.json"
    words = ["--situations", "2", "--real-time-factor", "10", "--out", str(out)]
    ended = subprocess.run([str(compare), *words], capture_output=True, text=True, check=False, timeout=200)
    assert ended.returncode == 0, ended.stdout[-2000:] + ended.stderr
    report = json.loads(out.read_text(encoding="utf-8"))
    assert report["situations"] == report["same_to_the_tick"] == 2
    assert report["met"]
    assert report["prediction"]["chains"] == len(report["prediction"]["errors_s"]) == 2
    assert report["prediction"]["mae_s"] < 1.0


def test_means_that_are_apart_are_told() -> None:
    told = summary([Compared(10.0, 10.0), Compared(11.0, 10.0)])
    assert told["difference_percent"] == pytest.approx(5.0)
    assert told["same_to_the_tick"] == 1
    assert not told["met"]


def test_predictions_are_compared_with_what_the_nodes_drove() -> None:
    runs = [
        Compared(10.0, 10.0, 9.8),
        Compared(11.0, 10.0, 11.1),
        Compared(30.0, 9.0),  # as of a chain that failed
        Compared(8.0, 8.0),
    ]
    told = prediction_summary(runs)  # without the chain that failed, and the one that was not predicted
    assert told["errors_s"] == [-0.2, 0.1]
    assert told["chains"] == 2
    assert told["mean_error_s"] == pytest.approx(-0.05)
