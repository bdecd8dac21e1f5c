"""What a node is started with: its command line, parameters and parameter files; good and bad."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import Start
from process import Process
from ros_client import Client

Run = Callable[..., tuple[int, str]]


@pytest.fixture
def run(domain: int, tmp_path: Path) -> Run:
    """Give a function that runs a node with these words until it ends: its exit code and output."""

    def wait_for(name: str, *words: str) -> tuple[int, str]:
        node = Process(name, tmp_path / "log", domain, list(words))
        try:
            return node.wait(), node.output
        finally:
            node.kill()

    return wait_for


@pytest.mark.parametrize(
    ("name", "parameter"), [("executor", "odom_timeout"), ("refinement", "gate"), ("simulation", "lockstep")]
)
def test_help_tells_the_parameters(run: Run, name: str, parameter: str) -> None:
    code, output = run(name, "--help")
    assert code == 0
    assert f"\n  {parameter} " in output


def test_words_that_are_not_ros_s_end_a_node(run: Run) -> None:
    code, output = run("simulation", "--real-time-factor", "5", "--ros-args", "-p", "seed:=1")
    assert code == 2
    assert "unrecognized arguments: --real-time-factor 5" in output


@pytest.mark.parametrize(
    ("name", "parameters", "expected"),
    [
        ("executor", {"odom_timeout": "nan"}, "odom_timeout"),
        ("executor", {"odom_timeout": -1.0}, "odom_timeout"),
        ("executor", {"frame": 3}, "frame"),
        ("executor", {"stamped_commands": "maybe"}, "stamped_commands"),
        ("executor", {"ball_noise": 0.02}, "parameters ball_noise and ball_velocity_noise: expected both"),
        ("executor", {"ball_velocity_noise": 0.1}, "expected both above 0 or both 0, got 0 and 0.1"),
        ("refinement", {"gate": 0.5}, "gate"),
        ("refinement", {"models": "[a, b]"}, "models"),
        ("simulation", {"seed": 1.5}, "seed"),
        ("simulation", {"ball_dropouts": 2.0}, "ball_dropouts"),
    ],
)
def test_wrong_parameters_end_a_node_with_one_line(start, name: str, parameters, expected: str) -> None:
    node = start(name, **parameters)
    assert node.wait() == 1
    assert expected in node.output
    assert "Traceback" not in node.output


@pytest.mark.parametrize(
    "content", [None, "{", "executor: [", "/**:\n  ros__parameters:\n    frame: [1, a]\n"]
)
def test_a_damaged_parameter_file_ends_a_node_with_one_line(
    run: Run, tmp_path: Path, content: str | None
) -> None:
    file = tmp_path / "executor.yaml"
    if content is not None:
        file.write_text(content)
    code, output = run("executor", "--ros-args", "--params-file", str(file))
    assert code == 1
    assert "Traceback" not in output
    assert str(file) in output or "frame" in output


def test_a_parameter_that_does_not_exist_is_named(start: Start, client: Client) -> None:
    node = start("simulation", real_time_factr=5.0)
    told = "ignored: parameters real_time_factr: expected some of "
    client.eventually(lambda: told in node.output, told)
    assert "real_time_factor" in node.output.partition(told)[2]
