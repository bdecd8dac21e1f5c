"""`train` learns from a recording of the nodes."""

import random
from pathlib import Path

import pandas as pd
import pytest
from chain_client import ChainClient, call, chain_of_the_paper
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from process import Processes, executable, run
from recorder import Recorder
from ros_client import Client

from ator_interfaces.msg import ActionPerformance, ChainPerformance, Outcome, TopCall
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.experience.recordings import read_recording
from ator_ros.geometry import Pose
from ator_ros.nodes.network import free_domain
from ator_ros.nodes.qos import LATCHED, RESULTS, SENSOR_DATA
from ator_ros.performance.model_file import load_model
from ator_ros.robot.description import load_robot
from ator_ros.world.messages import pose_from

pytestmark = [pytest.mark.node, pytest.mark.long]

TOPICS = {
    "/performance/action": (ActionPerformance, RESULTS),
    "/performance/chain": (ChainPerformance, LATCHED),
    "/odom": (Odometry, SENSOR_DATA),
    "/cmd_vel": (Twist, SENSOR_DATA),
}
TOUR = 21


Recording = tuple[Recorder, list[ActionPerformance]]
"""A recording, and the published records."""


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """Execute and record the paper's chain, and a tour."""
    with free_domain() as domain:
        processes = Processes(domain, tmp_path_factory.mktemp("logs"))
        processes.start("simulation", real_time_factor=10.0, command_wait=1.0)
        processes.start("executor", odom_timeout=10.0, start_timeout=30.0)
        client = Client(domain)
        try:
            chains, recorder = ChainClient(client), Recorder(client, TOPICS)
            execute(chains, chain_of_the_paper())
            client.place(robot=Pose(0.0, 0.0, 0.0), ball=(3.0, 2.0))
            execute(chains, tour(TOUR, seed=32))
        finally:  # a simulation as fast as possible leaves little CPU time for the tests
            client.close()
            processes.kill()
    return recorder, chains.actions


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


def check_places(frame: pd.DataFrame, records: list[ActionPerformance], *, within: float) -> None:
    """Assert that starts and goals of episodes match the records; `within` in m."""
    for row, record in zip(frame.to_dict("records"), records, strict=True):
        begin = pose_from(record.start.robot, "start")
        goal = pose_from(record.call.goal.pose, "goal")
        assert begin.distance(Pose(row["x"], row["y"], 0.0)) < within
        assert goal.distance(Pose(row["xg"], row["yg"], 0.0)) < within


def test_records_of_the_executor_are_the_episodes(recording: Recording, tmp_path: Path) -> None:
    recorder, published = recording
    folder = recorder.write(tmp_path / "bag", *TOPICS)
    assert (folder / "metadata.yaml").is_file()
    experience = read_recording(folder, load_robot(), SOCCER)
    for action in ("goToPose", "dribbleBall", "shoot"):
        records = [record for record in published if record.action == action]
        episodes = experience.of(action)
        assert episodes["duration"].tolist() == [record.actual.duration for record in records]
        assert episodes["success"].all()
        check_places(episodes, records, within=1e-9)


def test_the_installed_train_learns_from_the_recording(recording: Recording, tmp_path: Path) -> None:
    folder = recording[0].write(tmp_path / "bag", *TOPICS)
    models = tmp_path / "models"
    ended = run(executable("train"), folder, "--models", models)
    assert ended.returncode == 0, ended.stderr
    assert "dribbleBall: expected at least 20 episodes" in ended.stderr
    model = load_model(models / "goToPose.json", load_robot(), SOCCER.known_features)
    assert model.metadata["training"]["episodes"] == TOUR + 1
    assert str(tmp_path) not in (models / "goToPose.json").read_text(encoding="utf-8")
