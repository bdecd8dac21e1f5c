"""Two minutes of chains back to back: the nodes end as they began."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix

from ator_ros.tools.soak_report import NODES

DURATION = 120.0


@pytest.mark.node
def test_two_minutes_leave_the_nodes_as_they_were(tmp_path: Path) -> None:
    soak = Path(get_package_prefix("ator_ros"), "lib", "ator_ros", "soak")
    out = tmp_path / "soak.json"
    ended = subprocess.run(
        [str(soak), "--duration", str(DURATION), "--out", str(out)],
        capture_output=True,
        text=True,
        check=False,
        timeout=3 * DURATION,
    )
    assert ended.returncode == 0, ended.stdout[-2000:] + ended.stderr
    report = json.loads(out.read_text(encoding="utf-8"))
    assert report["worse"] == []
    assert set(report["nodes"]) == set(NODES)
    assert report["chains"] >= 5
    assert len(report["hiccups"]) < 2  # an answer that ROS loses is told, and the next chain tried
    assert report["odom_to_command_ms"][1]["median"] > 0.0
