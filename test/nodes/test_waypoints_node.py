"""The node `waypoints` with the nodes of a tour: clients of Nav2 drive along waypoints."""

import importlib
import math
from collections.abc import Iterator
from itertools import groupby, pairwise
from typing import Any

import pytest
from action_msgs.msg import GoalStatus
from arena import LONG_START
from chain_client import ChainClient
from geometry_msgs.msg import PoseStamped
from nav2_interfaces import provide_nav2_msgs
from process import PATIENCE, Process, Processes
from rclpy.action import ActionClient, ActionServer
from ros_client import Client, SentGoal
from tf2_msgs.msg import TFMessage

from ator_interfaces.action import ExecuteChain
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of
from ator_ros.nodes.qos import ACTION_QUEUES, LATCHED
from ator_ros.nodes.simulation import transform_of

pytestmark = [pytest.mark.node, pytest.mark.long]

START = Pose(-2.0, 0.0, 0.0)
SQUARE = [Pose(0.0, 0.0, 3.0), Pose(0.5, 1.5, -2.0), Pose(-1.5, 1.5, 0.5)]
OUTSIDE = Pose(90.0, 0.0, 0.0)


def seconds(duration: Any) -> float:
    """Return a duration in s."""
    return duration.sec + 1e-9 * duration.nanosec


class SentPoses(SentGoal):
    """An accepted goal of one of the two actions."""

    def end(self) -> tuple[int, Any]:
        """Wait for the end; return status and result."""
        return self.response().status, self.response().result

    def waypoints(self) -> list[int]:
        """Return the waypoints of the feedback, each once while it does not change."""
        return [number for number, _ in groupby(each.current_waypoint for each in self.feedback)]


class Navigator:
    """A client of the two actions, as nav2_simple_commander is one, beside the nodes of a tour."""

    def __init__(self, client: Client, node: Process) -> None:
        self.client, self.node, self.chains = client, node, ChainClient(client)
        kinds = importlib.import_module("nav2_msgs.action")
        self._clients = {
            name: (kind, ActionClient(client.node, kind, f"waypoints/{name}"))
            for name, kind in (
                ("follow_waypoints", kinds.FollowWaypoints),
                ("navigate_through_poses", kinds.NavigateThroughPoses),
            )
        }

    def send(self, name: str, poses: list[Pose], frame: str = "odom", **fields: Any) -> SentPoses:
        """Send a goal; wait until it is accepted."""
        stamped = [PoseStamped(pose=pose_of(pose)) for pose in poses]
        for each in stamped:
            each.header.frame_id = frame
        return self.send_goal(name, stamped, **fields)

    def send_goal(self, name: str, poses: list[PoseStamped], **fields: Any) -> SentPoses:
        """Send a goal; wait until it is accepted."""
        kind, server = self._clients[name]
        assert server.wait_for_server(timeout_sec=PATIENCE), self.node.output
        self.client.wait_for_discovery_by(f"waypoints/{name}")
        return SentPoses(self.client, server, kind.Goal(poses=poses, **fields))

    def is_at(self, pose: Pose) -> bool:
        """Return whether the robot is at a pose, within the tolerance of the tour's TOP."""
        there = self.client.robot().pose
        return there.distance(pose) < 0.3 and math.cos(there.yaw - pose.yaw) > math.cos(0.3)


@pytest.fixture(scope="module")
def nodes(shared: tuple[Processes, Client]) -> Iterator[Navigator]:
    processes, client = shared
    with pytest.MonkeyPatch.context() as patch:
        provide_nav2_msgs(patch)
        started = {
            "simulating": processes.start(
                "simulation", domain="tour", real_time_factor=10.0, command_wait=0.5
            ),
            "": processes.start("drive_to_server"),
            "ready for chains": processes.start(
                "executor", domain="tour", odom_timeout=2.0, refinement_timeout=3.0
            ),
            "refining chains": processes.start(
                "refinement", domain="tour", deadline=1.0, gate=False
            ),
            "become chains": processes.start("waypoints", domain="tour"),
        }
        for words, node in started.items():
            client.eventually(
                lambda n=node, w=words: w in n.output, f"{node.name} is ready", LONG_START
            )
        made = Navigator(client, started["become chains"])
        client.eventually(lambda: client.robots, "odometry")
        made.chains.wait_for_publishers()
        yield made


@pytest.fixture
def navigator(nodes: Navigator) -> Navigator:
    """Return the client, with the robot at the start and the usual parameters."""
    nodes.client.place(robot=START)
    nodes.client.eventually(
        lambda: nodes.is_at(START) and nodes.chains.standing(), "the robot at the start"
    )
    assert all(
        each.successful
        for each in nodes.client.set_parameters(
            "waypoints", stop_on_failure=True, order="given", keep_last=True, return_home=False
        )
    )
    nodes.client.set_parameters("executor", action_timeout=60.0)
    nodes.chains.chains.clear()
    return nodes


def test_waypoints_are_followed_with_headings_that_refinement_chose(navigator: Navigator) -> None:
    sent = navigator.send("follow_waypoints", SQUARE)
    status, result = sent.end()
    assert (status, result.error_code) == (GoalStatus.STATUS_SUCCEEDED, 0), result
    assert (sent.waypoints(), result.missed_waypoints) == ([0, 1, 2], [])
    assert navigator.is_at(SQUARE[2])
    (record,) = navigator.chains.chains
    assert [list(call.open) for call in record.chain.calls] == [["yaw"], ["yaw"], []]
    assert record.refined, record.refinement


def test_poses_are_navigated_through_with_times_from_the_models(navigator: Navigator) -> None:
    poses = SQUARE * 3
    sent = navigator.send("navigate_through_poses", poses)
    status, result = sent.end()
    assert (status, result.error_code) == (GoalStatus.STATUS_SUCCEEDED, 0), result
    remaining = [
        number for number, _ in groupby(each.number_of_poses_remaining for each in sent.feedback)
    ]
    assert remaining == [*range(9, 0, -1)]
    assert seconds(sent.feedback[0].estimated_time_remaining) > 1.0
    first = next(each for each in sent.feedback if each.number_of_poses_remaining == 8)
    last = sent.feedback[-1]
    took = seconds(last.navigation_time) - seconds(first.navigation_time)
    assert seconds(first.estimated_time_remaining) == pytest.approx(took, rel=0.25)
    assert max(seconds(each.estimated_time_remaining) for each in sent.feedback) < 1.25 * (
        took + 5.0
    )
    legs = [start.distance(end) for start, end in pairwise(poses)]
    assert first.distance_remaining == pytest.approx(sum(legs), abs=0.3)
    assert last.distance_remaining < 0.3
    assert last.current_pose.header.frame_id == "odom"


def test_loops_begin_at_the_index_of_the_goal(navigator: Navigator) -> None:
    sent = navigator.send("follow_waypoints", SQUARE[:2], number_of_loops=1, goal_index=1)
    status, result = sent.end()
    assert status == GoalStatus.STATUS_SUCCEEDED, result
    assert sent.waypoints() == [1, 0, 1]
    (record,) = navigator.chains.chains
    assert [list(call.open) for call in record.chain.calls] == [[], ["yaw"], []]


def test_a_canceled_goal_ends_when_the_robot_stands(navigator: Navigator) -> None:
    sent = navigator.send("follow_waypoints", SQUARE)
    navigator.chains.wait_until_moving()
    assert sent.cancel()
    assert sent.end()[0] == GoalStatus.STATUS_CANCELED
    assert navigator.chains.standing()


def test_a_newer_goal_preempts_also_one_of_the_other_action(navigator: Navigator) -> None:
    first = navigator.send("follow_waypoints", SQUARE, number_of_loops=100)
    navigator.chains.wait_until_moving()
    second = navigator.send("navigate_through_poses", SQUARE[1:])
    status, result = first.end()
    assert (status, result.error_msg) == (GoalStatus.STATUS_ABORTED, "a newer goal took over")
    unusable = navigator.send("navigate_through_poses", [OUTSIDE])
    assert unusable.end()[0] == GoalStatus.STATUS_ABORTED  # and the other one goes on
    assert second.end()[0] == GoalStatus.STATUS_SUCCEEDED
    assert navigator.is_at(SQUARE[2])


def test_an_older_goal_that_is_readable_later_does_not_preempt(navigator: Navigator) -> None:
    older = navigator.send("navigate_through_poses", [START], "cellar")
    newer = navigator.send("follow_waypoints", [SQUARE[0]])
    navigator.chains.wait_until_moving()
    static = navigator.client.node.create_publisher(TFMessage, "/tf_static", LATCHED)
    cellar = transform_of(0.0, Pose(0.0, 0.0, 0.0), frame="odom", child="cellar")
    static.publish(TFMessage(transforms=[cellar]))
    status, result = older.end()
    assert (status, result.error_msg) == (GoalStatus.STATUS_ABORTED, "a newer goal took over")
    assert newer.end()[0] == GoalStatus.STATUS_SUCCEEDED
    assert navigator.is_at(SQUARE[0])


def test_each_of_many_goals_has_a_result_and_the_last_one_wins(navigator: Navigator) -> None:
    client, number = navigator.client, 100
    kind = importlib.import_module("nav2_msgs.action").FollowWaypoints
    server = ActionClient(client.node, kind, "waypoints/follow_waypoints", **ACTION_QUEUES)
    assert server.wait_for_server(timeout_sec=PATIENCE)
    client.wait_for_discovery_by("waypoints/follow_waypoints")
    goals = [kind.Goal(poses=[PoseStamped(pose=pose_of(pose))]) for pose in SQUARE[:2]]
    chosen = [goals[each == number - 1] for each in range(number)]
    sent = client.within(lambda: [server.send_goal_async(goal) for goal in chosen])
    client.eventually(lambda: all(each.done() for each in sent), "100 acceptances")
    results = client.within(lambda: [each.result().get_result_async() for each in sent])
    client.eventually(lambda: all(each.done() for each in results), "100 results", 2 * PATIENCE)
    statuses = [each.result().status for each in results]
    assert statuses == [GoalStatus.STATUS_ABORTED] * (number - 1) + [GoalStatus.STATUS_SUCCEEDED]
    assert navigator.is_at(SQUARE[1])
    server.destroy()


def test_only_headings_that_count_are_checked(navigator: Navigator) -> None:
    def send(*without: int) -> SentPoses:
        poses = [PoseStamped(pose=pose_of(pose)) for pose in SQUARE[:2]]
        for index in without:
            poses[index].pose.orientation.w = poses[index].pose.orientation.z = 0.0
        return navigator.send_goal("follow_waypoints", poses)

    assert send(0).end()[0] == GoalStatus.STATUS_SUCCEEDED
    assert navigator.is_at(SQUARE[1])
    status, result = send(0, 1).end()
    assert status == GoalStatus.STATUS_ABORTED
    assert [each.index for each in result.missed_waypoints] == [1]
    assert "poses[1].pose.orientation: expected a quaternion" in result.error_msg


def test_too_many_waypoints_are_refused(navigator: Navigator) -> None:
    result = navigator.send("navigate_through_poses", SQUARE * 1000).end()[1]
    assert result.error_msg == ("poses: expected at most 2000 poses, got 3000; send several goals")


def test_a_goal_ends_where_the_executor_was_restarted(navigator: Navigator) -> None:
    client, sent = navigator.client, navigator.send("follow_waypoints", SQUARE)
    navigator.chains.wait_until_moving()
    node = client.node  # DDS lists a killed node for some time
    another = client.within(
        lambda: ActionServer(node, ExecuteChain, "execute_chain", lambda _: None)
    )
    status, result = sent.end()
    client.within(another.destroy)
    assert (status, result.error_code) == (GoalStatus.STATUS_ABORTED, 603)
    assert "the executor was restarted" in result.error_msg
    client.eventually(navigator.chains.standing, "the robot stands")


def test_a_waypoint_outside_the_fence_is_missed_before_the_robot_moves(
    navigator: Navigator,
) -> None:
    poses = [SQUARE[0], OUTSIDE, SQUARE[2]]
    status, result = navigator.send("follow_waypoints", poses).end()
    assert (status, result.error_code) == (GoalStatus.STATUS_ABORTED, 603)
    assert [each.index for each in result.missed_waypoints] == [1]
    assert "inside the fence" in result.error_msg
    assert navigator.is_at(START)
    navigator.client.set_parameters("waypoints", stop_on_failure=False)
    sent = navigator.send("follow_waypoints", poses)
    status, result = sent.end()
    assert (status, result.error_code) == (GoalStatus.STATUS_SUCCEEDED, 0)
    assert ([each.index for each in result.missed_waypoints], sent.waypoints()) == ([1], [0, 2])
    assert result.missed_waypoints[0].goal.pose.position.x == OUTSIDE.x


def test_after_a_waypoint_that_is_not_reached_the_next_is_driven_to(navigator: Navigator) -> None:
    navigator.client.set_parameters("waypoints", stop_on_failure=False)
    navigator.client.set_parameters("executor", action_timeout=6.0)
    poses = [START.ahead(0.5), START.ahead(6.5), START.ahead(5.5)]
    sent = navigator.send("follow_waypoints", poses)
    status, result = sent.end()
    assert status == GoalStatus.STATUS_SUCCEEDED, result
    assert [(each.index, each.error_code) for each in result.missed_waypoints] == [(1, 9000)]
    assert sent.waypoints() == [0, 1, 2]
    assert navigator.is_at(poses[2])


def test_poses_in_other_frames_are_transformed_or_rejected(navigator: Navigator) -> None:
    status, result = navigator.send("navigate_through_poses", SQUARE, "attic").end()
    assert (status, result.error_code) == (GoalStatus.STATUS_ABORTED, 9102)
    assert "expected the frame 'odom', got 'attic'" in result.error_msg
    status, result = navigator.send("follow_waypoints", SQUARE, "attic").end()
    assert status == GoalStatus.STATUS_ABORTED
    assert [each.error_code for each in result.missed_waypoints] == [9002] * 3
    static = navigator.client.node.create_publisher(TFMessage, "/tf_static", LATCHED)
    origin = Pose(1.0, 2.0, 1.0)
    static.publish(TFMessage(transforms=[transform_of(0.0, origin, frame="map", child="odom")]))
    there = origin.compose(SQUARE[2])
    assert (
        navigator.send("follow_waypoints", [there], "map").end()[0] == GoalStatus.STATUS_SUCCEEDED
    )
    assert navigator.is_at(SQUARE[2])


def test_an_unusable_goal_is_refused_with_a_reason(navigator: Navigator) -> None:
    for name, poses, fields, code in (
        ("follow_waypoints", [], {}, 602),
        ("follow_waypoints", SQUARE, {"goal_index": 3}, 602),
        ("navigate_through_poses", SQUARE, {"behavior_tree": "tree.xml"}, 9101),
    ):
        status, result = navigator.send(name, poses, **fields).end()
        assert (status, result.error_code) == (GoalStatus.STATUS_ABORTED, code)
        assert "expected" in result.error_msg


def test_an_open_order_is_driven_and_waypoints_are_counted_as_sent(navigator: Navigator) -> None:
    navigator.client.set_parameters("waypoints", order="open")
    near_last = [START.ahead(far) for far in (3.0, 1.0, 2.0, 4.0)]
    sent = navigator.send("follow_waypoints", near_last)
    status, result = sent.end()
    assert status == GoalStatus.STATUS_SUCCEEDED, result
    assert sent.waypoints()[-4:] == [1, 2, 0, 3]
    (record,) = navigator.chains.chains
    assert list(record.order) == [1, 2, 0, 3]
    assert [each.step for each in record.actions] == [1, 2, 0, 3]
    assert navigator.is_at(near_last[3])


def test_a_tour_ends_where_it_began_with_its_last_waypoint_free(navigator: Navigator) -> None:
    navigator.client.set_parameters("waypoints", order="open", keep_last=False, return_home=True)
    sent = navigator.send("navigate_through_poses", [START.ahead(2.0), START.ahead(1.0)])
    status, result = sent.end()
    assert status == GoalStatus.STATUS_SUCCEEDED, result
    assert navigator.is_at(START)
    (record,) = navigator.chains.chains
    assert [sorted(call.open) for call in record.chain.calls] == [
        ["order", "yaw"],
        ["order"],  # `keep_headings` has the last one
        [],
    ]
    remaining = [
        number for number, _ in groupby(f.number_of_poses_remaining for f in sent.feedback)
    ]
    assert remaining == [2, 1, 0]
    assert sent.feedback[-1].distance_remaining < 0.3
