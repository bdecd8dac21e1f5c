"""All nodes of nav2.launch.xml beside a stand-in for Nav2, in a namespace, without any file."""

import importlib
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from geometry_msgs.msg import PoseStamped
from nav2_interfaces import provide_nav2_msgs
from process import PATIENCE, environment, executable
from rclpy.action import ActionClient
from ros_client import Client, SentGoal

from ator_interfaces.msg import ActionPerformance, WatchedDrives
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of
from ator_ros.nodes.qos import LATCHED, RESULTS

NAMESPACE = "robot_1"
NODES = ("watch", "refinement", "executor", "waypoints")
READY = {
    "watch": "on the map",
    "refinement": "on the map",
    "executor": "ready for chains",
    "waypoints": "on the map",
}
IN_NAMESPACE = ("-r", f"__ns:=/{NAMESPACE}", "-r", "/tf:=tf", "-r", "/tf_static:=tf_static")


class Programs:
    """Programs on a ROS domain, with their output in a folder."""

    def __init__(self, domain: int, folder: Path) -> None:
        self._environment, self._folder = environment(domain), folder
        self._started: list[subprocess.Popen[bytes]] = []

    def start(self, name: str, *words: str) -> None:
        with (self._folder / f"{name}.log").open("wb") as log:
            self._started.append(
                subprocess.Popen(
                    [*words, "--ros-args", *IN_NAMESPACE],
                    stdout=log, stderr=subprocess.STDOUT, env=self._environment,
                )
            )  # fmt: skip

    def run(self, *words: str) -> str:
        done = subprocess.run(
            words, capture_output=True, text=True, env=self._environment, check=False
        )
        assert done.stderr == ""  # launch fails on any other output
        return done.stdout

    def output(self, name: str) -> str:
        return (self._folder / f"{name}.log").read_text(encoding="utf-8")

    def kill(self) -> None:
        for process in self._started:
            process.kill()
            process.wait()


@pytest.fixture
def programs(domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Programs]:
    provide_nav2_msgs(monkeypatch)
    made = Programs(domain, tmp_path)
    yield made
    made.kill()


@pytest.mark.long
def test_a_client_of_waypoints_is_served_and_its_drives_are_watched(
    programs: Programs, domain: int, tmp_path: Path
) -> None:
    module = (sys.executable, "-m", "ator_ros_examples.nav2_stand_in")
    programs.start("stand_in", *module)
    setup = (sys.executable, "-m", "ator_ros.start", "commands.nav2_setup")
    folder = programs.run(*setup, "--folder", str(tmp_path), "--namespace", NAMESPACE)
    assert Path(folder).parent == tmp_path / NAMESPACE
    for name in NODES:
        words = ("--ros-args", "--params-file", f"{folder}/nav2.yaml", "--")
        programs.start(name, executable(name), *words)
    end = time.monotonic() + 4 * PATIENCE
    while not all(text in programs.output(name) for name, text in READY.items()):
        assert time.monotonic() < end, [programs.output(name) for name in NODES]
        time.sleep(0.2)

    client = Client(domain, NAMESPACE, silent=True)
    try:
        tallies = client.listen(WatchedDrives, "watch/drives", LATCHED)
        kind = importlib.import_module("nav2_msgs.action").FollowWaypoints
        sender = ActionClient(client.node, kind, "waypoints/follow_waypoints")
        assert sender.wait_for_server(PATIENCE)
        poses = [PoseStamped(pose=pose_of(Pose(x, 0.0, 0.0))) for x in (-4.0, -2.5, -4.5)]
        for pose in poses:
            pose.header.frame_id = "map"
        result = SentGoal(client, sender, kind.Goal(poses=poses)).response().result
        assert (result.error_code, result.error_msg) == (0, "")
        client.eventually(lambda: tallies and tallies[-1].drives == len(poses), "three drives")

        records = client.listen(ActionPerformance, "performance/action", RESULTS)
        kind = importlib.import_module("nav2_msgs.action").NavigateThroughPoses
        sender = ActionClient(client.node, kind, "waypoints/navigate_through_poses")
        assert sender.wait_for_server(PATIENCE)
        for pose, x in zip(poses, (-3.0, -1.5, 0.0), strict=True):
            pose.pose.position.x = x
        result = SentGoal(client, sender, kind.Goal(poses=poses)).response().result
        assert (result.error_code, result.error_msg) == (0, "")
        client.eventually(lambda: len(records) == len(poses), "three records")
        assert [record.stopped for record in records] == [False, False, True]
        assert all(record.actual.accuracy < 0.2 for record in records)
        # those that were preempted where the robot passed are learned from, too
        client.eventually(lambda: tallies[-1].drives > len(poses) + 1, "a passed drive")
    finally:
        client.close()
    for name in NODES:
        assert "ignored: parameters" not in programs.output(name)
