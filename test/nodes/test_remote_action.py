"""Actions on external servers: valid servers, and each fault that ends an action."""

import time
from collections.abc import Iterator
from typing import Any

import pytest
from action_servers import Server
from remote_bench import GOAL, Bench

from ator_interfaces.action import ExecuteChain
from ator_ros.actions.base import Status
from ator_ros.world.messages import pose_from
from ator_ros.world.state import STOP

SLACK = 1.0
"""Tolerance in real s for a busy machine."""


@pytest.fixture
def bench(domain: int) -> Iterator[Bench]:
    made = Bench(domain)
    yield made
    made.close()


def test_a_goal_is_sent_as_declared_once_the_robot_is_at_rest(bench: Bench) -> None:
    server = Server(bench.server_node)
    bench.begin()
    assert [bench.tick(v=0.5).command for _ in range(3)] == [STOP] * 3
    assert not server.goals
    bench.drive(lambda: server.goals)
    (call,) = server.goals[0].request.chain.calls
    assert (call.top, call.speed, call.goal.header.frame_id) == ("goToPose", 0.3, "map")
    assert pose_from(call.goal.pose, "goal") == pytest.approx(GOAL.pose)
    assert server.goals[0].request.fetches == 3
    assert server.goals[0].request.chain.action_set == "odom"


@pytest.mark.parametrize(
    ("end", "expected"),
    [
        (
            {"state": "abort", "code": 2, "reason": "blocked"},
            "aborted; outcome.code: FAILED \\(2\\) \\(blocked\\)",
        ),
        ({"state": "succeed", "code": 2}, "drive failed: outcome.code: FAILED \\(2\\)"),
        ({"state": "abort", "code": 1}, "drive failed: its goal is aborted"),
    ],
)
def test_an_unsuccessful_result_is_reported(bench: Bench, end: dict[str, Any], expected: str) -> None:
    server = Server(bench.server_node)
    bench.begin()
    bench.drive(lambda: server.goals)
    server.finish(**end)
    step, took = bench.outcome()
    assert step.status is Status.FAILED
    assert took < SLACK
    with pytest.raises(AssertionError, match=expected):
        raise AssertionError(step.message)


def test_a_rejected_goal_fails_immediately(bench: Bench) -> None:
    Server(bench.server_node, accepts=False)
    bench.begin()
    step, took = bench.outcome()
    assert (step.status, step.message) == (Status.REFUSED, "drive rejected the goal")
    assert took < SLACK


def test_a_goal_accepted_too_late_is_canceled(bench: Bench) -> None:
    server = Server(bench.server_node)
    bench.begin()
    bench.freeze()
    late = "drive did not answer the goal: expected that within 0.5 s"
    assert bench.outcome()[0].message == late
    bench.resume()
    bench.until(lambda: server.canceled)


def test_without_a_server_it_fails_after_its_timeout(bench: Bench) -> None:
    bench.action.start(bench.world(), GOAL)
    step, took = bench.outcome()
    assert step.message == "drive: expected one action server within 0.6 s, got none"
    assert 0.6 < took < 0.6 + SLACK
    assert all(step.command == STOP for step in bench.steps)


def test_a_server_that_dies_is_detected(bench: Bench) -> None:
    server = Server(bench.server_node)
    bench.begin()
    bench.drive(lambda: server.goals)
    server.destroy()
    step, took = bench.outcome()
    assert step.message == "drive is gone: its action server has been missing for 0.6 s"
    assert took < 0.6 + 2.0 * SLACK
    assert not bench.server.ending()  # no server to wait for


def drive_for(bench: Bench, duration: float) -> None:
    """Step the action for `duration` real s."""
    end = time.monotonic() + duration
    bench.drive(lambda: time.monotonic() > end)


def test_a_killed_server_is_detected_long_before_dds_drops_it(bench: Bench) -> None:
    Server(bench.server_node)
    bench.declare(result=600.0)
    bench.begin()
    drive_for(bench, 1.2)  # longer than `silence`: the server responds
    bench.freeze()
    step, took = bench.outcome()
    assert step.message == "drive is gone or hangs: expected a sign of life within 0.6 s, got none"
    assert step.status is Status.FAILED
    assert 0.4 < took < 0.6 + SLACK
    bench.until(lambda: "it may still move the robot" in bench.server.warning())


def test_feedback_resets_the_silence_timeout(bench: Bench) -> None:
    server = Server(bench.server_node)
    bench.declare(result=600.0)
    bench.begin()
    drive_for(bench, 0.5)
    bench.freeze()  # it answers no request
    for _ in range(4):
        drive_for(bench, 0.3)
        server.goals[-1].publish_feedback(ExecuteChain.Feedback())
    assert "is gone or hangs" in bench.outcome()[0].message


def test_a_server_that_never_ends_times_out_and_is_canceled(bench: Bench) -> None:
    server = Server(bench.server_node)
    bench.begin()
    step, took = bench.outcome()
    assert step.message == "drive took too long: expected a result within 4 s, got none"
    assert took < 4.0 / 5.0 + SLACK
    assert bench.server.ending()
    bench.until(lambda: server.canceled)
    server.finish("canceled")
    bench.until(lambda: not bench.server.ending(), patience=0.5 + SLACK)
    assert bench.server.warning() == ""


def test_two_servers_with_one_name_are_rejected(bench: Bench) -> None:
    servers = [Server(bench.server_node), Server(bench.server_node)]
    bench.begin()
    bench.until(lambda: "got 2" in bench.server.unusable())
    step, took = bench.outcome()
    within = "expected one action server within 0.6 s"
    assert step.message == f"drive: {within}, got 2: each would move the robot"
    assert 0.6 < took < 0.6 + SLACK
    assert not any(server.goals for server in servers)
