"""Actions on external servers: valid servers, and each fault that ends an action."""

import dataclasses
import importlib
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rclpy
from action_msgs.srv import CancelGoal
from action_servers import Server, SilentServer, declared
from nav2_interfaces import provide_nav2_msgs
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from ator_interfaces.action import ExecuteChain
from ator_ros.actions.base import Goal, Status, Step
from ator_ros.actions.remote import Filling, Success
from ator_ros.bases.description import load_robot
from ator_ros.geometry import Pose
from ator_ros.nodes.remote_actions import RemoteAction, RemoteServer
from ator_ros.world.readers import pose_from
from ator_ros.world.state import STOP, RobotState, World

ROBOT = load_robot()
GOAL = Goal(Pose(1.0, 2.0, 0.5), 0.3)
PERIOD = 0.02
"""Duration of a tick in real s; by the stamps it is five times as long."""


class Bench:
    """The node of the client and that of the server, in one rclpy executor of this process."""

    def __init__(self, domain: int) -> None:
        self._context = rclpy.Context()
        self._context.init(domain_id=domain)
        self.client_node, self.server_node, self.controller_node = self._nodes = [
            Node(name, context=self._context)
            for name in ("client_node", "server_node", "controller_node")
        ]
        self._executor = SingleThreadedExecutor(context=self._context)
        for node in self._nodes:
            self._executor.add_node(node)
        self.warnings: list[str] = []
        self.early = False
        self.server_goals: Callable[[], Any] = list
        self.declare()
        self.steps: list[Step] = []
        self._time = 0.0

    def declare(self, cancel_too: tuple[str, ...] = (), **timeouts: float) -> None:
        """Set `cancel_too` and the timeouts of the server's declaration."""
        call = declared(cancel_too=cancel_too, early=self.early)
        call = dataclasses.replace(call, timeouts=dataclasses.replace(call.timeouts, **timeouts))
        self.server = RemoteServer(self.client_node, call, "odom", self.warnings.append)
        self.action = RemoteAction(ROBOT, self.server)

    def freeze(self) -> None:
        """Stop spinning the server's node, as if it was killed: DDS still lists it."""
        self._executor.remove_node(self.server_node)

    def resume(self) -> None:
        self._executor.add_node(self.server_node)

    def spin(self) -> None:
        end = time.monotonic() + PERIOD
        while time.monotonic() < end:
            self._executor.spin_once(timeout_sec=PERIOD / 4.0)

    def begin(self) -> None:
        """Wait for the server, and start the action."""
        self.until(self.server.present)
        self.action.start(self.world(), GOAL)

    def world(self, v: float = 0.0) -> World:
        return World(self._time, RobotState(Pose(0.0, 0.0, 0.0), v))

    def tick(self, v: float = 0.0) -> Step:
        self.spin()
        self._time += 5.0 * PERIOD
        self.steps.append(self.action.step(self.world(v)))
        return self.steps[-1]

    def warned(self, text: str) -> bool:
        """Check the server; return whether one of its warnings has this text."""
        self.server.check()
        return any(text in warning for warning in self.warnings)

    def until(self, happened: Callable[[], Any], patience: float = 5.0) -> None:
        end = time.monotonic() + patience
        while not happened():
            assert time.monotonic() < end
            self.spin()

    def drive(self, happened: Callable[[], Any]) -> None:
        """Step the action until a condition holds; the action must not end before."""
        end = time.monotonic() + 5.0
        while not happened():
            assert time.monotonic() < end
            assert self.tick().status is Status.RUNNING, self.steps[-1]

    def outcome(self, patience: float = 10.0) -> tuple[Step, float]:
        """Step the action until it ends; return its last step and the duration."""
        began = time.monotonic()
        while self.tick().status is Status.RUNNING:
            assert time.monotonic() - began < patience
        self.action.end("over")
        return self.steps[-1], time.monotonic() - began

    def close(self) -> None:
        self._executor.shutdown()
        for node in self._nodes:
            for waitable in list(node.waitables):  # otherwise they outlive their node
                getattr(waitable, "destroy", bool)()
            node.destroy_node()
        self._context.try_shutdown()


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


def test_it_ends_once_the_robot_stands_unless_its_goal_has_a_speed(bench: Bench) -> None:
    server = Server(bench.server_node)
    bench.until(bench.server.present)
    bench.action.start(bench.world(), dataclasses.replace(GOAL, speed=0.0))
    bench.drive(lambda: server.goals)
    server.finish()
    bench.until(lambda: bench.tick(v=0.3).command == STOP)
    assert bench.steps[-1].status is Status.RUNNING
    assert bench.tick().status is Status.SUCCEEDED

    bench.declare()
    bench.begin()
    bench.drive(lambda: len(server.goals) == 2)
    server.finish()
    bench.until(lambda: bench.tick(v=0.3).command == STOP)
    assert bench.steps[-1].status is Status.SUCCEEDED


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
def test_an_unsuccessful_result_is_reported(
    bench: Bench, end: dict[str, Any], expected: str
) -> None:
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


@pytest.mark.parametrize(
    ("code", "most"),
    [
        pytest.param(CancelGoal.Response.ERROR_NONE, 1, marks=pytest.mark.long),
        (CancelGoal.Response.ERROR_UNKNOWN_GOAL_ID, 4),
    ],
)
def test_a_goal_whose_acceptance_is_lost_is_canceled_by_its_id(
    bench: Bench, code: int, most: int
) -> None:
    server = SilentServer(bench.server_node, code)
    bench.begin()
    assert "did not answer the goal" in bench.outcome()[0].message
    for _ in range(round(3.0 / PERIOD)):
        bench.server.check()
        bench.spin()
    assert len(server.goals) == 1
    assert server.canceled == server.goals * most


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
    bench.until(lambda: bench.warned("it may still move"))


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
    assert not bench.warned("")


def test_two_servers_with_one_name_are_rejected(bench: Bench) -> None:
    servers = [Server(bench.server_node), Server(bench.server_node)]
    bench.begin()
    bench.until(lambda: "got 2" in bench.server.unusable())
    step, took = bench.outcome()
    within = "expected one action server within 0.6 s"
    assert step.message == f"drive: {within}, got 2: each would move the robot"
    assert 0.6 < took < 0.6 + SLACK
    assert not any(server.goals for server in servers)


@pytest.fixture
def controller(bench: Bench) -> Iterator[Server]:
    """Yield another server, which has a goal of the first one, as Nav2's controller has."""
    made = Server(bench.controller_node, "follow_path")
    client = ActionClient(bench.server_node, ExecuteChain, "follow_path")
    bench.until(client.server_is_ready)
    client.send_goal_async(ExecuteChain.Goal())
    bench.until(lambda: made.goals)
    bench.declare(cancel_too=("follow_path", "spin"), result=600.0, server=5.0)
    yield made
    client.destroy()


@pytest.mark.parametrize("kind", ["hangs", "ends", "ignores its cancellation"])
def test_what_drives_for_a_server_is_canceled_with_it(
    bench: Bench, controller: Server, kind: str
) -> None:
    server = Server(bench.server_node)
    bench.begin()
    drive_for(bench, 1.2)
    assert not controller.canceled
    if kind == "hangs":
        bench.freeze()
        assert "drive is gone" in bench.outcome()[0].message
    elif kind == "ends":
        server.destroy()
        assert "drive is gone" in bench.outcome()[0].message
    else:
        bench.action.end("canceled by the client")
    bench.until(lambda: bench.warned("canceled 1 goals of follow_path"))
    assert controller.canceled == controller.goals


def test_what_drives_for_a_server_is_canceled_before_the_node_ends(
    bench: Bench, controller: Server
) -> None:
    server = Server(bench.server_node)
    bench.begin()
    bench.drive(lambda: server.goals)
    drive_for(bench, 0.2)
    bench.freeze()  # not noticed yet
    bench.action.end("the executor was ended")
    bench.server.stop()
    bench.until(lambda: controller.canceled)
    assert bench.server.ending() is False
    assert not bench.warned("it may still move")


def test_a_server_that_ends_its_canceled_goal_leaves_others_alone(
    bench: Bench, controller: Server
) -> None:
    server = Server(bench.server_node)
    bench.begin()
    bench.drive(lambda: server.goals)
    bench.action.end("canceled by the client")
    bench.until(lambda: server.canceled)
    server.finish("canceled")
    bench.until(lambda: not bench.server.ending())
    assert not bench.warned("")
    assert not controller.canceled


def take_over(bench: Bench, *, early: bool) -> None:
    """Drive to a goal, and let another action take over."""
    bench.early = early
    bench.declare()
    former = bench.action
    bench.begin()
    bench.drive(bench.server_goals)
    drive_for(bench, 0.2)
    bench.action = RemoteAction(ROBOT, bench.server)
    bench.action.start(bench.world(0.6), GOAL)
    bench.action.take_over(former)
    former.end("passed")


def test_a_newer_goal_is_sent_while_the_robot_drives(bench: Bench) -> None:
    server = Server(bench.server_node)
    bench.server_goals = lambda: server.goals
    take_over(bench, early=True)
    assert bench.tick(v=0.6).command is None
    bench.drive(lambda: len(server.goals) == 2)
    drive_for(bench, 0.2)
    assert not server.canceled
    server.finish("abort", number=0)  # as a server does that was preempted
    drive_for(bench, 0.1)
    server.finish()
    assert bench.outcome()[0].status is Status.SUCCEEDED
    assert not bench.server.ending()


def test_both_goals_are_canceled_if_the_newer_one_ends_first(bench: Bench) -> None:
    server = Server(bench.server_node)
    bench.server_goals = lambda: server.goals
    take_over(bench, early=True)
    bench.tick(v=0.6)
    bench.action.end("canceled by the client")
    bench.until(lambda: len(server.canceled) == 2)


def test_a_server_that_hangs_before_it_accepts_a_newer_goal_is_detected(bench: Bench) -> None:
    server = Server(bench.server_node)
    bench.server_goals = lambda: server.goals
    take_over(bench, early=True)
    bench.freeze()
    step, took = bench.outcome()
    assert step.message == "drive did not answer the goal: expected that within 0.5 s"
    assert took < 0.5 + SLACK
    bench.resume()
    bench.until(lambda: len(server.canceled) == 2)


def test_a_server_that_hangs_as_soon_as_it_has_a_newer_goal_is_detected(bench: Bench) -> None:
    server = Server(bench.server_node)
    bench.server_goals = lambda: server.goals
    take_over(bench, early=True)
    bench.drive(lambda: len(server.goals) == 2)
    bench.drive(lambda: bench.steps[-1].message == "executed by drive")
    bench.freeze()
    step, took = bench.outcome()
    assert step.message == "drive is gone or hangs: expected a sign of life within 0.6 s, got none"
    assert took < 0.6 + SLACK


def test_a_server_is_ending_until_both_goals_are_over(bench: Bench) -> None:
    server = Server(bench.server_node)
    bench.server_goals = lambda: server.goals
    take_over(bench, early=True)
    bench.drive(lambda: len(server.goals) == 2)
    drive_for(bench, 0.1)
    bench.action.end("a newer goal took over")
    bench.until(lambda: len(server.canceled) == 2)
    server.finish("canceled", number=1)
    end = time.monotonic() + 0.2
    bench.until(lambda: time.monotonic() > end)
    assert bench.server.ending()
    server.finish("canceled", number=0)
    bench.until(lambda: not bench.server.ending())


def test_a_server_that_does_not_declare_it_is_stopped_between_goals(bench: Bench) -> None:
    server = Server(bench.server_node)
    bench.server_goals = lambda: server.goals
    take_over(bench, early=False)
    assert bench.tick(v=0.6).command == STOP
    bench.until(lambda: len(server.canceled) == 1)
    assert len(server.goals) == 1


def at(x: float) -> Goal:
    return Goal(Pose(x, 0.0, 0.0))


class Run:
    """Actions that drive through three goals, with the server that does so.

    `result` is the timeout of its result in s.
    """

    def __init__(self, bench: Bench, *, early: bool = False, result: float = 600.0) -> None:
        kind = importlib.import_module("nav2_msgs.action").NavigateThroughPoses
        through = declared(
            server="through",
            type="nav2_msgs/action/NavigateThroughPoses",
            goal=(Filling("poses", source="goals", frame="map"),),
            success=Success(),
        )
        timeouts = dataclasses.replace(through.timeouts, result=result)
        through = dataclasses.replace(through, timeouts=timeouts, early=early)
        self.bench = bench
        self.single = Server(bench.server_node)
        self.server = Server(bench.server_node, "through", kind=kind)
        bench.declare()
        bench.server.through = RemoteServer(
            bench.client_node, through, "odom", bench.warnings.append
        )
        bench.action = RemoteAction(ROBOT, bench.server)
        bench.until(bench.server.through.present)
        self.start(at(1.0), at(2.0), at(3.0))
        bench.drive(lambda: self.server.goals)

    def start(self, goal: Goal, *following: Goal) -> None:
        self.bench.action.start(self.bench.world(), goal)
        if following:
            self.bench.action.followed_by(following)

    def next(self, goal: Goal, *following: Goal) -> None:
        """Let an action to the next goal take over."""
        former = self.bench.action
        self.bench.action = RemoteAction(ROBOT, self.bench.server)
        self.start(goal, *following)
        self.bench.action.take_over(former)
        former.end("passed")

    def sent(self) -> list[list[float]]:
        goals = [handle.request.poses for handle in self.server.goals]
        return [[pose.pose.position.x for pose in poses] for poses in goals]


@pytest.fixture
def through(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> Run:
    provide_nav2_msgs(monkeypatch)
    return Run(bench)


def test_a_run_of_passed_goals_is_one_goal_of_the_server_that_drives_through(through: Run) -> None:
    assert through.sent() == [[1.0, 2.0, 3.0]]
    assert through.server.goals[0].request.poses[0].header.frame_id == "map"
    assert through.bench.action.drives_on
    through.next(at(2.0), at(3.0))
    drive_for(through.bench, 0.2)
    through.next(at(3.0))
    assert not through.bench.action.drives_on
    drive_for(through.bench, 0.2)
    through.server.finish()
    assert through.bench.outcome()[0].status is Status.SUCCEEDED
    assert (len(through.sent()), through.server.canceled, through.single.goals) == (1, [], [])


def test_the_rest_of_a_run_is_sent_where_a_goal_is_passed_if_the_server_takes_newer_goals(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    provide_nav2_msgs(monkeypatch)
    through = Run(bench, early=True)
    for count, rest in enumerate(([2.0, 3.0], [3.0]), 2):
        through.next(*map(at, rest))
        assert through.bench.tick(v=0.6).command is None
        through.bench.drive(lambda n=count: len(through.server.goals) == n)
        drive_for(through.bench, 0.1)
        through.server.finish("abort", number=count - 2)
    through.server.finish()
    assert through.bench.outcome()[0].status is Status.SUCCEEDED
    assert through.sent() == [[1.0, 2.0, 3.0], [2.0, 3.0], [3.0]]
    assert (through.server.canceled, through.single.goals) == ([], [])


def test_the_rest_of_a_run_is_sent_again_if_it_has_changed(through: Run) -> None:
    through.next(at(2.5), at(3.0))
    assert through.bench.tick(v=0.6).command is None
    through.bench.drive(lambda: len(through.server.goals) == 2)
    through.next(at(3.5))
    through.bench.drive(lambda: len(through.server.goals) == 3)
    assert through.sent()[1:] == [[2.5, 3.0], [3.5]]
    assert not through.single.goals


@pytest.mark.parametrize("early", [False, True])
def test_each_leg_of_a_run_has_the_timeout_of_a_result(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, early: bool
) -> None:
    provide_nav2_msgs(monkeypatch)
    through = Run(bench, early=early, result=4.0)  # 0.8 real s
    drive_for(bench, 0.5)
    through.next(at(2.0), at(3.0))
    drive_for(bench, 0.5)
    step, took = bench.outcome()
    assert step.message == "through took too long: expected a result within 4 s, got none"
    assert took < 4.0 / 5.0 + SLACK
    bench.until(lambda: through.server.goals[-1] in through.server.canceled)


def test_a_run_is_canceled_in_its_middle(through: Run) -> None:
    through.next(at(2.0), at(3.0))
    drive_for(through.bench, 0.1)
    through.bench.action.end("canceled by the client")
    assert through.bench.server.through is not None
    assert through.bench.server.through.ending()
    through.bench.until(lambda: through.server.canceled)


def test_a_newer_goal_takes_over_from_a_run(through: Run) -> None:
    through.next(at(2.0), at(3.0))
    drive_for(through.bench, 0.1)
    through.bench.action.end("a newer goal took over")
    through.bench.until(lambda: through.server.canceled)
    through.server.finish("canceled")
    assert through.bench.server.through is not None
    through.bench.until(lambda: not through.bench.server.through.ending())
    through.bench.action = RemoteAction(ROBOT, through.bench.server)
    through.start(at(5.0))
    through.bench.drive(lambda: through.single.goals)
    through.single.finish()
    assert through.bench.outcome()[0].status is Status.SUCCEEDED
    assert through.sent() == [[1.0, 2.0, 3.0]]


def test_a_server_that_hangs_in_the_middle_of_a_run_is_detected(through: Run) -> None:
    drive_for(through.bench, 1.2)  # longer than `silence`: the server responds
    through.next(at(2.0), at(3.0))
    through.bench.freeze()
    step, _ = through.bench.outcome()
    assert "is gone or hangs" in step.message
