"""Command line, parameters and parameter files of a node."""

import importlib
import signal
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest
from conftest import Host, Start
from ros_client import Client

from ator_ros.nodes.network import PROFILES

Ended = Callable[..., tuple[str | int | None, str]]


@pytest.fixture
def ended(
    domain: int, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Iterator[Ended]:
    """Return a function that runs a node's `main`; it returns exit code and output.

    It runs in this process, which is ten times as fast; a text as exit code counts as 1.
    """
    signals = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    monkeypatch.setenv(PROFILES, "")  # restored after the test, since the node sets it

    def run(name: str, *words: str) -> tuple[str | int | None, str]:
        node = importlib.import_module(f"ator_ros.nodes.{name}")
        with pytest.raises(SystemExit) as end:
            node.main([name, *words])
        output = capfd.readouterr()
        return end.value.code, output.out + output.err

    yield run
    for number, handler in signals.items():
        signal.signal(number, handler)


@pytest.mark.parametrize(
    ("name", "parameter"),
    [("executor", "odom_timeout"), ("refinement", "gate"), ("simulation", "lockstep")],
)
def test_help_lists_the_parameters(ended: Ended, name: str, parameter: str) -> None:
    code, output = ended(name, "--help")
    assert code == 0
    assert f"\n  {parameter} " in output


def test_unknown_arguments_end_a_node(ended: Ended) -> None:
    code, output = ended("simulation", "--real-time-factor", "5", "--ros-args", "-p", "seed:=1")
    assert code == 2
    assert "unrecognized arguments: --real-time-factor 5" in output


@pytest.mark.parametrize(
    ("name", "parameters", "expected"),
    [
        ("executor", {"odom_timeout": "nan"}, "odom_timeout"),
        ("executor", {"odom_timeout": 1}, "odom_timeout"),
        ("executor", {"frame": 3}, "frame"),
        (
            "executor",
            {"domain": "chess"},
            "domain: expected an entry point of ator_ros.domains, one of [",
        ),
        (
            "executor",
            {"stamped_commands": "maybe"},
            "stamped_commands: expected one of auto, true, false",
        ),
        (
            "executor",
            {"robot_from": "tf", "frame": "/map", "robot_frame": "map"},
            "robot_frame: expected another",
        ),
        ("executor", {"fence": "[0.0, 0.0, 0.0]"}, "parameter fence: expected"),
        (
            "executor",
            {"map": "rooms.pgm"},
            "parameter map: expected a file (.yaml) or the name of a topic",
        ),
        ("simulation", {"seed": ""}, "seed:="),
        ("learning", {"records": "['bad topic']"}, "Invalid topic name"),
        (
            "executor",
            {"ball_noise": 0.02},
            "parameters ball_noise and ball_velocity_noise: expected both",
        ),
        ("refinement", {"gate": 0.5}, "gate"),
        ("refinement", {"models": "[a, b]"}, "models"),
        ("simulation", {"ball_dropouts": 2.0}, "ball_dropouts"),
        ("simulation", {"real_time_factor": -1.0}, "real_time_factor"),
        (
            "simulation",
            {"robot_start": "[1.0]"},
            "robot_start: expected finite x, y and yaw of 1 to 1",
        ),
        ("simulation", {"ball_start": "[0.0, 70.0]"}, "ball_start.y: expected a finite number"),
    ],
)
def test_wrong_parameters_end_a_node_with_one_line(
    ended: Ended, name: str, parameters: dict[str, object], expected: str
) -> None:
    words = [word for pair in parameters.items() for word in ("-p", "{}:={}".format(*pair))]
    output, _ = ended(name, "--ros-args", *words)
    assert expected in output
    assert "\n" not in output


def test_a_wrong_parameter_ends_the_process_with_one_line(start: Start) -> None:
    node = start("simulation", ball_dropouts=2.0)
    assert node.wait() == 1
    assert node.output.splitlines()[-1].startswith(
        "simulation: parameter ball_dropouts (probability that "
    )
    assert "Traceback" not in node.output


@pytest.mark.parametrize(
    "content", [None, "{", "executor: [", "/**:\n  ros__parameters:\n    frame: [1, a]\n"]
)
def test_a_damaged_parameter_file_ends_a_node_with_one_line(
    ended: Ended, tmp_path: Path, content: str | None
) -> None:
    file = tmp_path / "executor.yaml"
    if content is not None:
        file.write_text(content)
    output, _ = ended("executor", "--ros-args", "--params-file", str(file))
    assert "\n" not in output
    assert str(file) in output


@pytest.mark.parametrize("name", ["executor", "refinement", "simulation"])
def test_an_unreadable_robot_file_ends_a_node_with_one_line(
    ended: Ended, tmp_path: Path, name: str
) -> None:
    file = tmp_path / "robot.yaml"
    output, _ = ended(name, "--ros-args", "-p", f"robot:={file}")
    assert f"{file}: expected a readable YAML file: " in output
    assert "\n" not in output


def test_an_unknown_parameter_is_reported(host: Host, client: Client) -> None:
    node = host("simulation", real_time_factr=5.0)
    expected = "ignored: parameters real_time_factr: expected some of "
    client.eventually(lambda: expected in node.output, expected)
    assert "real_time_factor" in node.output.partition(expected)[2]


@pytest.mark.skipif(find_spec("nav2_msgs") is not None, reason="nav2_msgs is installed")
def test_without_nav2_msgs_waypoints_ends_with_one_line(start: Start) -> None:
    node = start("waypoints")
    assert node.wait() == 1
    (line,) = node.output.splitlines()
    assert "expected nav2_msgs/action/FollowWaypoints to be installed, as by `apt install" in line
