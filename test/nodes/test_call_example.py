"""The example that calls services where there is no command `ros2`."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest
from conftest import Host, Start
from ros_client import Client

from ator_interfaces.msg import SearchCurve, TopCall, TopChain
from ator_interfaces.srv import PlaceObject, RefineSubgoal
from ator_ros.examples.call import CallError, filled, lines

pytestmark = pytest.mark.node

REFINE = "ator_interfaces/srv/RefineSubgoal"
PLACE = "ator_interfaces/srv/PlaceObject"
EXECUTE = "ator_interfaces/action/ExecuteChain"


def started(*words: str, domain: int = 0) -> subprocess.Popen[str]:
    program = [sys.executable, "-m", "ator_ros.examples.call", *words]
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
    return subprocess.Popen(
        program, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    )


def call(*words: str, domain: int = 0) -> subprocess.CompletedProcess[str]:
    with started(*words, domain=domain) as program:
        output, errors = program.communicate(timeout=60.0)
    return subprocess.CompletedProcess(words, program.returncode, output, errors)


def test_a_service_is_called_and_its_answer_printed(host: Host, client: Client, domain: int) -> None:
    host("simulation")
    client.robot()
    done = call("place_ball", PLACE, "{position: {point: {x: 1, y: -0.5}}}", domain=domain)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "success: true\nmessage: ball at x 1.000 m, y -0.500 m\n"


def test_a_topic_is_echoed_one_field_per_line(host: Host, client: Client, domain: int) -> None:
    host("simulation")
    client.robot()
    done = call("echo", "odom", "--once", domain=domain)
    assert (done.returncode, done.stderr) == (0, "")
    printed = done.stdout.splitlines()
    assert printed[:2] == ["header:", "  stamp:"]
    assert "child_frame_id: base_link" in printed
    assert "      x: -2" in printed  # pose.pose.position.x, a float


def test_echo_names_a_topic_without_publisher(domain: int) -> None:
    done = call("echo", "/nothing", domain=domain)
    assert (done.returncode, done.stderr) == (
        1,
        "call: expected a publisher on /nothing within 10 s, found none\n",
    )


def test_messages_are_printed_one_field_per_line() -> None:
    calls = [TopCall(top="goToBall", open=["yaw"]), TopCall(speed=1.0 / 3.0)]
    request = RefineSubgoal.Request(chain=TopChain(calls=calls), as_given=True)
    printed = list(lines(request))
    assert "  calls[0]:" in printed
    assert "    top: goToBall" in printed
    assert "    open: [yaw]" in printed
    assert "    speed: 0.333333" in printed
    assert "as_given: true" in printed
    assert "alternatives: []" in printed
    assert all(line.split(":")[0].strip() for line in printed)


def test_long_lists_and_control_characters_are_shortened_and_quoted() -> None:
    answer = RefineSubgoal.Response(reason="one\ntwo", curves=[SearchCurve(values=[0.5] * 30)])
    printed = list(lines(answer))
    assert 'reason: "one\\ntwo"' in printed
    (values,) = [line for line in printed if line.startswith("  values")]
    assert values.endswith("0.5, … 30 in all]")


INSTALLED = "an installed PACKAGE/srv/NAME or PACKAGE/action/NAME"
CHAIN = """{chain: {calls: [{top: goToPose, goal: {pose: {position: {x: -1.5, y: 1.0}}}}]}}"""


def test_a_goal_is_sent_its_feedback_and_result_are_printed(
    start: Start, host: Host, client: Client, domain: int
) -> None:
    start("simulation", real_time_factor=5.0)
    host("executor")
    client.robot()
    done = call("execute_chain", EXECUTE, CHAIN, domain=domain)
    assert (done.returncode, done.stderr) == (0, "")
    feedback, result = done.stdout.split("result:\n")
    assert feedback.startswith("feedback:\n  chain_id: ")
    assert "  status: executing" in feedback
    assert result.startswith("  outcome:\n    code: 1\n")
    assert "arrived" in result


def test_an_interrupt_cancels_the_goal(start: Start, host: Host, client: Client, domain: int) -> None:
    start("simulation")
    executor = host("executor")
    client.robot()
    words = ["execute_chain", EXECUTE, CHAIN]
    with started(*words, domain=domain) as sent:
        client.eventually(lambda: client.robot().v > 0.1, "the robot drives")
        sent.send_signal(signal.SIGINT)
        output, errors = sent.communicate(timeout=20.0)
    assert sent.returncode == 1
    assert "canceled by the client" in output
    assert errors == "call: execute_chain: the goal was canceled\n"
    assert "goal ended: canceled" in executor.output


def test_a_service_of_another_type_is_named(host: Host, client: Client, domain: int) -> None:
    host("simulation")
    client.robot()
    done = call("place_ball", "std_srvs/srv/Trigger", domain=domain)
    assert done.returncode == 1
    assert f"found it with the type {PLACE}" in done.stderr


def test_a_service_that_there_is_not_is_not_found(domain: int) -> None:
    done = call("place_balls", "std_srvs/srv/Trigger", domain=domain)
    assert done.returncode == 1
    assert done.stderr.endswith(" s, found none\n")


@pytest.mark.parametrize("name", ["", "place ball!"])
@pytest.mark.parametrize(("kind", "what"), [(PLACE, "service"), (EXECUTE, "action")])
def test_a_name_that_nothing_can_have_is_refused(name: str, kind: str, what: str) -> None:
    done = call(name, kind)
    assert done.returncode == 1
    assert done.stderr.endswith(f"call: {what}: expected a name such as /reset, got {name!r}\n")


def test_lists_of_messages_are_filled() -> None:
    request = RefineSubgoal.Request()
    calls = [
        {"top": "goToBall", "open": ["yaw"]},
        {"top": "dribbleBall", "goal": {"pose": {"position": {"y": 2}}}},
    ]
    filled(request, {"chain": {"calls": calls}, "situation": {"robot": {"position": {"x": -2.0}}}})
    assert [each.top for each in request.chain.calls] == ["goToBall", "dribbleBall"]
    assert request.chain.calls[0].open == ["yaw"]
    assert request.chain.calls[1].goal.pose.position.y == 2.0
    assert request.situation.robot.position.x == -2.0


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"position": {"point": {"x": "far"}}}, r"request\.position\.point\.x: expected a float, got 'far'$"),
        ({"remove": 1}, r"request\.remove: expected a bool, got 1$"),
        ({"place": 1}, r"request: expected fields among .*position.*, got 'place'$"),
        (
            {"position": {"header": {"stamp": {"nanosec": -1}}}},
            r"request\.position\.header\.stamp\.nanosec: expected 0 to 4294967295, got -1$",
        ),
        (
            {"position": {"header": {"stamp": {"sec": 99999999999}}}},
            r"stamp\.sec: expected -2147483648 to 2147483647, got 99999999999$",
        ),
        ({"position": 3}, r"request\.position: expected fields with values, got 3$"),
        ([], r"request: expected fields with values, got \[\]$"),
    ],
)
def test_values_that_do_not_fit_are_refused(values: object, message: str) -> None:
    with pytest.raises(CallError, match=message):
        filled(PlaceObject.Request(), values)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ("reset", "std_srvs/Trigger"),
            f"call: type: expected {INSTALLED}, got std_srvs/Trigger\n",
        ),
        (
            ("reset", "std_srvs/srv/Tri"),
            f"call: type: expected {INSTALLED}, got std_srvs/srv/Tri\n",
        ),
        (("reset", "/srv/Trigger"), f"call: type: expected {INSTALLED}, got /srv/Trigger\n"),
        (
            ("reset", "std_srvs/srv/_trigger"),
            f"call: type: expected {INSTALLED}, got std_srvs/srv/_trigger\n",
        ),
        (
            ("refine_subgoal", REFINE, "{chain: {calls: 1}}"),
            "call: request.chain.calls: expected a list, got 1\n",
        ),
    ],
)
def test_what_cannot_be_called_is_told_in_one_line(words: tuple[str, ...], message: str) -> None:
    done = call(*words)
    assert (done.returncode, done.stderr) == (2, message)
