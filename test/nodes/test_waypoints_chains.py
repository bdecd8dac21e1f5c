"""The chains that the node `waypoints` sends, with a test in place of the executor."""

import importlib
from collections.abc import Iterator, Sequence

import pytest
from action_msgs.msg import GoalStatus
from action_servers import Server
from conftest import Host
from geometry_msgs.msg import PoseStamped
from moving_base import MovingBase
from nav2_interfaces import provide_nav2_msgs
from process import PATIENCE
from rclpy.action import ActionClient, ActionServer
from ros_client import Client, SentGoal

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import ActionPerformance, Outcome
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of

ACTIONS = {
    "FollowWaypoints": "waypoints/follow_waypoints",
    "NavigateThroughPoses": "waypoints/navigate_through_poses",
}


class Executor(Server):
    """Executes chains as the test says."""

    def chain(self, number: int = -1) -> list[float]:
        """Return x of the goals of a chain."""
        calls = self.goals[number].request.chain.calls
        return [call.goal.pose.position.x for call in calls]

    def report(self, step: int, order: Sequence[int]) -> None:
        self.goals[-1].publish_feedback(ExecuteChain.Feedback(step=step, order=list(order)))

    def end(self, order: Sequence[int], *, missed: int | None = None) -> None:
        """End the newest chain after its last step, or after one that was `missed`."""
        result = ExecuteChain.Result()
        result.record.order = list(order)
        for step in order:
            action = ActionPerformance(step=step)
            action.outcome.code = Outcome.FAILED if step == missed else Outcome.SUCCEEDED
            result.record.actions.append(action)
            if step == missed:
                break
        result.outcome.code = Outcome.SUCCEEDED if missed is None else Outcome.FAILED
        result.outcome.reason = "blocked"
        handle = self.goals[-1]
        getattr(handle, "succeed" if missed is None else "abort")()
        ActionServer.notify_execute(self, handle, lambda _: result)


class Waypoints:
    """A client of the node, with the executor of its chains."""

    def __init__(self, client: Client) -> None:
        self.client = client
        self.base = MovingBase(client)
        self.executor = client.within(lambda: Executor(client.node, "execute_chain"))

    def send(self, kind: str, *xs: float, **fields: int) -> SentGoal:
        """Send waypoints on a line with other fields of the goal, and wait for the chain."""
        action = getattr(importlib.import_module("nav2_msgs.action"), kind)
        server = ActionClient(self.client.node, action, ACTIONS[kind])
        assert server.wait_for_server(timeout_sec=PATIENCE)
        self.client.wait_for_discovery_by(ACTIONS[kind])
        poses = [PoseStamped(pose=pose_of(Pose(x, 0.0, 0.0))) for x in xs]
        for pose in poses:
            pose.header.frame_id = "odom"
        sent = SentGoal(self.client, server, action.Goal(poses=poses, **fields))
        self.wait_for_chain(1)
        return sent

    def wait_for_chain(self, number: int) -> None:
        self.client.eventually(lambda: len(self.executor.goals) == number, f"chain {number}")

    def end(self, order: Sequence[int], *, missed: int | None = None) -> None:
        self.client.within(lambda: self.executor.end(order, missed=missed))

    def close(self) -> None:
        self.client.within(self.executor.destroy)


@pytest.fixture
def waypoints(
    host: Host, client: Client, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Waypoints]:
    """Yield a client of the node with the parameters of the test."""
    provide_nav2_msgs(monkeypatch)
    made = Waypoints(client)
    host("waypoints", **{"domain": "drive", **request.param})
    yield made
    made.close()


def with_parameters(**parameters: object) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("waypoints", [parameters], indirect=True)


@with_parameters(order="open", stop_on_failure=False)
def test_an_open_order_goes_on_with_the_waypoints_that_are_left(waypoints: Waypoints) -> None:
    executor = waypoints.executor
    sent = waypoints.send("FollowWaypoints", 3.0, 1.0, 2.0, 4.0)
    waypoints.client.eventually(lambda: waypoints.client.robots, "odometry")
    executor.report(2, [1, 2, 0, 3])
    waypoints.client.eventually(lambda: sent.feedback, "feedback")
    assert sent.feedback[-1].current_waypoint == 2
    waypoints.end([1, 2, 0, 3], missed=2)
    waypoints.wait_for_chain(2)
    assert executor.chain() == [3.0, 4.0]
    calls = executor.goals[-1].request.chain.calls
    assert [list(call.open) for call in calls] == [["order", "yaw"], []]
    waypoints.end([0, 1])
    response = sent.response()
    assert response.status == GoalStatus.STATUS_SUCCEEDED
    assert [each.index for each in response.result.missed_waypoints] == [2]
    assert response.result.missed_waypoints[0].goal.pose.position.x == 2.0


@with_parameters(order="open", stop_on_failure=False)
def test_a_first_round_of_missed_waypoints_only_is_skipped(waypoints: Waypoints) -> None:
    """The first round begins at the last waypoint, which lies outside the fence."""
    sent = waypoints.send("FollowWaypoints", 1.0, 2.0, 90.0, goal_index=2, number_of_loops=1)
    assert waypoints.executor.chain() == [1.0, 2.0]
    waypoints.end([0, 1])
    response = sent.response()
    assert response.status == GoalStatus.STATUS_SUCCEEDED
    assert [each.index for each in response.result.missed_waypoints] == [2]


@with_parameters(order="open")
def test_a_waypoint_missed_in_an_open_order_is_named_as_sent(waypoints: Waypoints) -> None:
    sent = waypoints.send("FollowWaypoints", 3.0, 1.0, 2.0)
    waypoints.end([1, 0, 2], missed=0)
    response = sent.response()
    assert response.status == GoalStatus.STATUS_ABORTED
    assert [each.index for each in response.result.missed_waypoints] == [0]
    assert response.result.error_msg == "poses[0]: blocked"


@pytest.mark.parametrize(
    ("waypoints", "opened", "passing"),
    [
        ({"domain": "patrol"}, ["stop", "yaw"], True),
        ({"domain": "patrol", "passing": "never"}, ["yaw"], False),
        ({"domain": "patrol", "order": "open", "keep_last": False}, ["order", "stop", "yaw"], True),
        ({"domain": "drive"}, ["stop", "yaw"], False),  # that is, an arrival speed
        ({"domain": "drive", "order": "open", "keep_last": False}, ["order", "yaw"], False),
        ({"domain": "tour"}, ["yaw"], False),  # it cannot pass
    ],
    indirect=["waypoints"],
)
def test_stations_may_be_passed_if_the_action_can(
    waypoints: Waypoints, opened: list[str], passing: bool
) -> None:
    waypoints.send("NavigateThroughPoses", 3.0, 1.0, 2.0)
    calls = waypoints.executor.goals[-1].request.chain.calls
    assert [list(call.open) for call in calls[:2]] == [opened] * 2
    assert [call.passing for call in calls] == [passing, passing, False]
    waypoints.end([0, 1, 2])


@with_parameters()
@pytest.mark.parametrize("count", [9, 100, 150])
def test_up_to_a_hundred_poses_are_one_chain(waypoints: Waypoints, count: int) -> None:
    xs = [0.01 * number for number in range(count)]
    sent = waypoints.send("NavigateThroughPoses", *xs)
    for number, part in enumerate(filter(None, (xs[:100], xs[100:])), start=1):
        waypoints.wait_for_chain(number)
        assert waypoints.executor.chain() == part
        waypoints.end(range(len(part)))
    assert sent.response().status == GoalStatus.STATUS_SUCCEEDED


@with_parameters(order="open", return_home=True)
def test_a_long_round_leads_home_with_its_last_chain(waypoints: Waypoints) -> None:
    waypoints.client.eventually(lambda: waypoints.client.robots, "odometry")
    waypoints.base.pose = Pose(-1.0, 0.0, 0.0)
    waypoints.client.eventually(lambda: waypoints.client.robot().pose.x == -1.0, "odometry")
    xs = [0.01 * number for number in range(100)]
    sent = waypoints.send("FollowWaypoints", *xs)
    assert waypoints.executor.chain() == xs
    waypoints.end(range(100))
    waypoints.wait_for_chain(2)
    assert waypoints.executor.chain() == [-1.0]
    waypoints.end([0])
    assert sent.response().status == GoalStatus.STATUS_SUCCEEDED
