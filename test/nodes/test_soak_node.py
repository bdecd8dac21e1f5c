"""Chains back to back on the three nodes: after two minutes the nodes are as they began."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix

from ator_ros.files import read_json
from ator_ros.schema import structured
from ator_ros.tools.work.soak_report import NODES
from ator_ros.tools.work.soak_result import FORMAT, SoakReport

pytestmark = pytest.mark.node


def soaked(seconds: float, out: Path, *words: str) -> tuple[int, SoakReport]:
    """Run `soak`; return its exit code and its report."""
    soak = Path(get_package_prefix("ator_ros"), "lib", "ator_ros", "soak")
    ended = subprocess.run(
        [str(soak), "--duration", str(seconds), "--out", str(out), *words],
        capture_output=True,
        text=True,
        check=False,
        timeout=120.0 + 2 * seconds,
    )
    assert out.is_file(), ended.stdout[-2000:] + ended.stderr
    report = structured(FORMAT.content(read_json(out)), SoakReport, closed=True)
    assert set(report.nodes) == set(NODES)
    assert len(report.hiccups) < 2  # an answer that ROS loses is told, and the next chain tried
    assert (report.odom_to_command_ms[1].median or 0.0) > 0.0
    return ended.returncode, report


@pytest.mark.long
def test_a_short_soak_runs_chains_and_measures_the_nodes(tmp_path: Path) -> None:
    code, report = soaked(10.0, tmp_path / "soak.json", "--real-time-factor", "4")
    assert report.chains >= 1
    assert code == bool(report.worse)  # so short a run ends while the nodes still warm up


@pytest.mark.long
def test_two_minutes_leave_the_nodes_as_they_were(tmp_path: Path) -> None:
    code, report = soaked(120.0, tmp_path / "soak.json")
    assert report.worse == ()
    assert code == 0
    assert report.chains >= 5
