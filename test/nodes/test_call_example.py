"""The example that calls services, sends goals and echoes topics without the `ros2` command."""

import math
import signal
import subprocess
import sys
from types import SimpleNamespace

import pytest
from conftest import Host, Start
from documentation import ROOT
from nav_msgs.msg import Odometry
from process import environment, run
from ros_client import Client

from ator_interfaces.action import ExecuteChain
from ator_interfaces.srv import PlaceObject
from examples.call import CallError, FeedbackLines, filled, main

PLACE = "ator_interfaces/srv/PlaceObject"
CHAIN = "{chain: {calls: [{top: goToPose, goal: {pose: {position: {x: -1.5, y: 1.0}}}}]}}"
EXECUTE = ("execute_chain", "ator_interfaces/action/ExecuteChain", CHAIN)


PROGRAM = (sys.executable, str(ROOT / "examples" / "call.py"))


@pytest.mark.long
def test_a_service_is_called_and_its_answer_printed_and_a_topic_echoed(
    host: Host, client: Client, domain: int
) -> None:
    host("simulation")
    client.robot()
    done = run(*PROGRAM, "place_ball", PLACE, "{position: {point: {x: 1, y: -0.5}}}", domain=domain)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "success: true\nmessage: ball at x 1.000 m, y -0.500 m\n"
    done = run(*PROGRAM, "echo", "odom", "--once", domain=domain)
    assert (done.returncode, done.stderr) == (0, "")
    printed = done.stdout.splitlines()
    assert printed[0] == "header:"
    assert "child_frame_id: base_link" in printed
    assert any("x: -2.0" in line for line in printed)  # pose.pose.position.x


@pytest.mark.long
def test_it_ends_quietly_where_its_reader_has_ended(client: Client, domain: int) -> None:
    publisher = client.node.create_publisher(Odometry, "spoken", 10)
    client.node.create_timer(0.05, lambda: publisher.publish(Odometry()))
    command = (*PROGRAM, "echo", "spoken")
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "env": environment(domain)}
    with subprocess.Popen(command, text=True, **pipes) as echoing:
        assert echoing.stdout is not None
        assert echoing.stdout.readline() == "header:\n"
        echoing.stdout.close()
        assert echoing.wait(timeout=60.0) == -signal.SIGPIPE
        assert echoing.stderr is not None
        assert echoing.stderr.read() == ""


def test_a_goal_is_sent_and_feedback_and_result_printed_and_an_interrupt_cancels_it(
    start: Start, host: Host, client: Client, domain: int
) -> None:
    start("simulation")
    executor = host("executor")
    client.robot()
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "env": environment(domain)}
    with subprocess.Popen([*PROGRAM, *EXECUTE, "--feedback"], text=True, **pipes) as sent:
        client.eventually(lambda: client.robot().vx > 0.1, "the robot drives")
        sent.send_signal(signal.SIGINT)
        output, errors = sent.communicate(timeout=60.0)
    assert sent.returncode == 1
    lines = output.splitlines()
    feedback = [line for line in lines if line.startswith("feedback: {chain_id: ")]
    assert any("status: executing" in line for line in feedback)
    assert len(feedback) <= 20  # not one for each of some hundred messages
    assert lines[len(feedback)] == "canceled by the client"
    assert "result:\n  outcome:\n    code: 4\n    reason: canceled by the client\n" in output
    assert errors == "call: execute_chain: the goal was canceled\n"
    assert "goal ended: canceled" in executor.output


@pytest.mark.long
def test_a_call_waits_for_nodes_that_start(host: Host, domain: int) -> None:
    words = [*PROGRAM, "reset", "std_srvs/srv/Trigger"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "env": environment(domain)}
    with subprocess.Popen(words, text=True, **pipes) as called:
        waiting = called.stderr.readline()
        host("simulation")
        output, errors = called.communicate(timeout=60.0)
    assert waiting == "waiting for reset; nodes that start compile code\n"
    assert (called.returncode, errors) == (0, "")
    assert "success: true\n" in output


def test_feedback_is_printed_again_if_more_than_floats_changes(
    capsys: pytest.CaptureFixture[str],
) -> None:
    lines = FeedbackLines()
    for remaining in (1.25, -1.25, 1e-05, math.inf, math.nan, 2.0):
        feedback = ExecuteChain.Feedback(status="executing 1.5 m", predicted_remaining=remaining)
        lines.show(SimpleNamespace(feedback=feedback))
    lines.show(SimpleNamespace(feedback=ExecuteChain.Feedback(status="executing 1.6 m")))
    assert capsys.readouterr().out.count("feedback: ") == 2


@pytest.mark.parametrize(
    ("words", "message"),
    [
        pytest.param(
            ("echo", "/nothing"),
            "expected a publisher on /nothing within 10 s, found none",
            marks=pytest.mark.long,
        ),
        (("place ball!", PLACE), "place ball!"),
        (
            ("reset", "std_srvs/srv/Tri"),
            "type: expected an installed one, such as std_srvs/srv/Trigger, got",
        ),
    ],
)
def test_invalid_calls_are_reported(
    words: tuple[str, ...],
    message: str,
    domain: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    assert main(list(words)) == 1
    errors = capsys.readouterr().err
    assert errors.startswith("call: ")
    assert message in errors


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (
            {"position": {"point": {"x": "far"}}},
            r"request\.position\.point\.x: expected double, got 'far'$",
        ),
        ({"remove": 1}, r"request\.remove: expected boolean, got 1$"),
        ({"place": 1}, r"request: expected fields among .*position.*, got 'place'$"),
        ({"position": 3}, r"request\.position: expected fields with values, got 3$"),
    ],
)
def test_invalid_values_are_rejected(values: object, message: str) -> None:
    with pytest.raises(CallError, match=message):
        filled(PlaceObject.Request, values)
