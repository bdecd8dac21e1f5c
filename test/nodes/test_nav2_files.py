"""The files in config/nav2: nodes start with them, and have all of the parameters."""

import shutil
import time
from pathlib import Path

import pytest
import yaml
from conftest import Host
from documentation import ROOT
from nav2_interfaces import provide_nav2_msgs
from process import PATIENCE, Process
from ros_client import Client

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


def test_one_section_for_all_nodes_causes_no_warnings(
    host: Host, client: Client, tmp_path: Path
) -> None:
    file = tmp_path / "all.yaml"
    shared = {
        "frame": "odom", "robot_from": "odom", "fence": [-5.0, -5.0, 5.0, 5.0],
        "learned": "", "planner": "", "stamped_commands": "auto", "deadline": 0.1, "fense": 1,
    }  # fmt: skip
    file.write_text(yaml.safe_dump({"/**": {"ros__parameters": shared}}), encoding="utf-8")
    node = host("refinement", "--params-file", str(file))
    client.eventually(lambda: "ignored: parameters fense: expected" in node.output, "one warning")
