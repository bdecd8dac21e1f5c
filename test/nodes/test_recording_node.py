"""`train` learns from a recording of the nodes."""

import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags import own_types
from chain_client import ChainClient, call, chain_of_the_paper
from conftest import Start
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from process import executable, run
from rclpy.qos import QoSProfile
from ros_client import Client

from ator_interfaces.msg import ActionPerformance, ChainPerformance, Outcome, TopCall
from ator_ros.bases.description import load_robot
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.experience.recordings import read_recording
from ator_ros.geometry import Pose
from ator_ros.nodes.diagnostics import type_name
from ator_ros.nodes.qos import LATCHED, RESULTS, SENSOR_DATA
from ator_ros.performance.model_file import load_model
from ator_ros.world.readers import pose_from

DEPTH = 5000
"""Queue depth for a busy machine: nodes may publish hundreds of messages per second."""


class Recorder:
    """Stores all messages of topics, in publishing order.

    `topics` contains the message type and QoS profile by topic name, which begins with a slash.
    """

    def __init__(self, client: Client, topics: dict[str, tuple[Any, Any]]) -> None:
        self._types = {topic: type_name(kind) for topic, (kind, _) in topics.items()}
        self._messages: list[tuple[str, int, bytes]] = []
        for topic, (kind, offered) in topics.items():
            qos = QoSProfile(
                depth=DEPTH, reliability=offered.reliability, durability=offered.durability
            )
            client.node.create_subscription(kind, topic, self._keeper(topic), qos, raw=True)

    def _keeper(self, topic: str) -> Callable[[bytes, dict[str, int]], None]:
        def keep(raw: bytes, info: dict[str, int]) -> None:
            self._messages.append((topic, info["source_timestamp"], bytes(raw)))

        return keep

    def write(self, folder: Path, *topics: str) -> Path:
        """Write the messages of these topics to a new folder: MCAP file and metadata.yaml."""
        from rosbags.rosbag2 import StoragePlugin, Writer

        store = own_types()
        with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            links = {
                topic: writer.add_connection(topic, self._types[topic], typestore=store)
                for topic in topics
            }
            for topic, stamp, raw in sorted(self._messages, key=lambda kept: kept[1]):
                if topic in links:
                    writer.write(links[topic], stamp, raw)
        return folder


pytestmark = pytest.mark.long

TOPICS = {
    "/performance/action": (ActionPerformance, RESULTS),
    "/performance/chain": (ChainPerformance, LATCHED),
    "/odom": (Odometry, SENSOR_DATA),
    "/cmd_vel": (Twist, SENSOR_DATA),
}
TOUR = 21


def tour(length: int, *, seed: int) -> list[TopCall]:
    """Return goals, each at least 0.5 m from the previous one and away from the ball."""
    draw = random.Random(seed)
    poses: list[Pose] = []
    while len(poses) < length:
        pose = Pose(draw.uniform(-1.0, 0.5), draw.uniform(-1.5, -0.6), draw.uniform(-3.0, 3.0))
        if not poses or pose.distance(poses[-1]) > 0.5:
            poses.append(pose)
    return [call("goToPose", pose) for pose in poses]


def execute(chains: ChainClient, calls: list[TopCall]) -> ChainPerformance:
    """Execute a chain, assert its success, and wait for all its records."""
    count = len(chains.actions)
    result = chains.send(calls).result()
    assert result.outcome.code == Outcome.SUCCEEDED, result.outcome.reason
    chains.ros.eventually(lambda: len(chains.actions) == count + len(calls), "the actions' records")
    return result.record


def test_the_installed_train_learns_from_the_records_of_the_executor(
    start: Start, client: Client, tmp_path: Path
) -> None:
    start("simulation", real_time_factor=10.0, command_wait=1.0)
    start("executor", odom_timeout=10.0, start_timeout=30.0)
    chains, recorder = ChainClient(client), Recorder(client, TOPICS)
    execute(chains, chain_of_the_paper())
    client.place(robot=Pose(0.0, 0.0, 0.0), ball=(3.0, 2.0))
    execute(chains, tour(TOUR, seed=32))
    folder = recorder.write(tmp_path / "bag", *TOPICS)
    assert (folder / "metadata.yaml").is_file()
    experience = read_recording(folder, load_robot(), SOCCER)
    for action in ("goToPose", "dribbleBall", "shoot"):
        records = [record for record in chains.actions if record.action == action]
        episodes = experience.of(action)
        assert episodes["duration"].tolist() == [record.actual.duration for record in records]
        assert episodes["success"].all()
        goals = [pose_from(record.call.goal.pose, "goal")[:2] for record in records]
        assert episodes[["xg", "yg"]].to_numpy() == pytest.approx(np.array(goals))
    models = tmp_path / "models"
    ended = run(executable("train"), folder, "--models", models)
    assert ended.returncode == 0, ended.stderr
    assert "dribbleBall: 1 drive corrects path times; 20 are enough for a tree" in ended.stderr
    model = load_model(models / "goToPose.json", load_robot(), SOCCER.known_features)
    assert model.metadata["training"]["episodes"] == TOUR + 1
    assert str(tmp_path) not in (models / "goToPose.json").read_text(encoding="utf-8")
