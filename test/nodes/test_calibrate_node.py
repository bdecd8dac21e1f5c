"""`calibrate` drives the simulated base over ROS and writes a valid description."""

import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from conftest import Start
from geometry_msgs.msg import TwistStamped
from moving_base import MovingBase
from nav_msgs.msg import Odometry
from process import executable, run
from ros_client import Client

from ator_ros.bases.description import load_robot
from ator_ros.nodes.qos import SENSOR_DATA
from ator_ros.resources import resource_path

AWAY = [3.5, 2.0]


def calibrate(domain: int, *words: str) -> subprocess.CompletedProcess[str]:
    """Run the command on a ROS domain."""
    return run(executable("calibrate"), *words, domain=domain)


@pytest.fixture
def publish(domain: int) -> Iterator[Callable[..., None]]:
    """Yield a function that publishes an odometry message repeatedly."""
    client = Client(domain, name="strange_base", silent=True)
    publisher = client.node.create_publisher(Odometry, "odom", SENSOR_DATA)

    def repeat(message: Odometry, step: int) -> None:
        message.header.stamp.sec += step
        publisher.publish(message)

    yield lambda message, step=1: client.node.create_timer(0.02, lambda: repeat(message, step))
    client.close()


def test_invalid_odometry_is_reported(
    publish: Callable[..., None], domain: int, tmp_path: Path
) -> None:
    message = Odometry(child_frame_id="base_link")
    message.header.frame_id, message.pose.pose.orientation.w = "robot1/odom", 1.0
    publish(message)
    done = calibrate(domain, "--out", str(tmp_path / "mine.yaml"))
    assert done.returncode == 1
    line = done.stderr.splitlines()[-1]
    assert line.startswith("calibrate: odom: expected a message within 5 s")
    assert "expected the frame 'odom', got 'robot1/odom'; set frame:=robot1/odom (of cal" in line


@pytest.mark.long
def test_constant_stamps_are_reported(
    publish: Callable[..., None], domain: int, tmp_path: Path
) -> None:
    message = Odometry(child_frame_id="base_link")
    message.header.frame_id, message.header.stamp.sec, message.pose.pose.orientation.w = (
        "odom",
        3,
        1.0,
    )
    publish(message, step=0)
    done = calibrate(domain, "--out", str(tmp_path / "mine.yaml"))
    assert (
        "newer message every 2 s; odom: the stamps of /strange_base stay at 3.00 s" in done.stderr
    )


@pytest.mark.long
def test_a_base_that_subscribes_to_stamped_commands_is_driven(domain: int, tmp_path: Path) -> None:
    client = Client(domain, silent=True)
    MovingBase(client, TwistStamped).set_pace(3.0)
    file = tmp_path / "mine.yaml"
    try:
        done = calibrate(domain, "--stamped", "true", "--v", "0.8", "--out", str(file))
    finally:
        client.close()
    assert done.returncode == 0, done.stderr
    assert load_robot(file).limits.v == pytest.approx(0.8, rel=0.05)


@pytest.mark.long
def test_an_implausible_estimate_is_not_written(domain: int, tmp_path: Path) -> None:
    """Odometry shows twice the commanded speed."""
    client = Client(domain, silent=True)
    MovingBase(client, share=2.0).set_pace(10.0)
    file = tmp_path / "mine.yaml"
    try:
        done = calibrate(domain, "--v", "0.8", "--out", str(file))
    finally:
        client.close()
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("calibrate: response of v: expected odometry")
    assert not file.exists()


@pytest.mark.long
def test_a_description_is_written(start: Start, domain: int, tmp_path: Path) -> None:
    timing = {"real_time_factor": 5.0, "command_wait": 0.5, "latency": 0.1}
    start("simulation", **timing, ball_start=AWAY)
    file = tmp_path / "mine.yaml"
    shipped = str(resource_path("config", "pioneer.yaml"))
    done = calibrate(domain, "--robot", shipped, "--name", "mine", "--out", str(file))
    assert done.returncode == 0, done.stderr
    word, latency, *_ = done.stdout.split()
    assert word == "latency"
    assert float(latency) == pytest.approx(0.1, abs=0.01)
    found, true = load_robot(file), load_robot()
    assert found.name == "mine"
    for name in ("v", "w", "a", "brake", "aw"):
        assert getattr(found.limits, name) == pytest.approx(getattr(true.limits, name), rel=0.05)


@pytest.mark.long
def test_another_publisher_of_commands_is_an_error(
    start: Start, client: Client, domain: int, tmp_path: Path
) -> None:
    """The test's client is one: it has a publisher of cmd_vel."""
    start("simulation", real_time_factor=5.0)
    client.eventually(lambda: bool(client.robots), "odometry")
    done = calibrate(domain, "--out", str(tmp_path / "mine.yaml"))
    assert done.returncode == 1
    assert "cmd_vel: expected no other publisher" in done.stderr
    assert not (tmp_path / "mine.yaml").exists()
