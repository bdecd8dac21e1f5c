"""The files in config/nav2: nodes start with them, and have all of the parameters."""

import shutil
import time
from pathlib import Path

import pytest
from documentation import ROOT
from nav2_interfaces import provide_nav2_msgs
from process import PATIENCE, Process

pytestmark = pytest.mark.node
READY = {
    "executor": "ready for chains of turtlebot4 (domain stations",
    "refinement": "refining chains",
    "learning": "learning from",
    "waypoints": "waypoints",
}


@pytest.mark.parametrize("name", READY)
def test_nodes_start(
    tmp_path: Path, domain: int, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    provide_nav2_msgs(monkeypatch)
    for file in ("nav2/stations.yaml", "nav2/nav2.yaml", "building/map.png"):
        shutil.copy(ROOT / "config" / file, tmp_path)
    shutil.copy(ROOT / "config" / "turtlebot4.yaml", tmp_path / "my_robot.yaml")
    shutil.copy(ROOT / "config" / "building" / "map.yaml", tmp_path / "map.yaml")
    monkeypatch.chdir(tmp_path)
    node = Process(name, tmp_path / "log", domain, ["--ros-args", "--params-file", "nav2.yaml"])
    try:
        end = time.monotonic() + PATIENCE
        while READY[name] not in node.output:
            assert node.running, node.output
            assert time.monotonic() < end, node.output
            time.sleep(0.1)
        assert "ignored: parameters" not in node.output
    finally:
        node.kill()
