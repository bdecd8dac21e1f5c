"""The `executor` node over its ROS interfaces; all tests share one set of processes."""

import math
import signal

import pytest
from action_msgs.msg import GoalStatus, GoalStatusArray
from chain_client import PATROL, ChainClient, SentChain, call, chain_of_the_paper
from nav_msgs.msg import Path
from process import Process, Processes
from rclpy.qos import qos_profile_action_status_default
from ros_client import Client, values_of
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

from ator_interfaces.msg import Outcome
from ator_ros.geometry import Pose
from ator_ros.nodes.qos import LATCHED

SETTINGS = {
    # Long, since the machine may be busy with other tests.
    "executor": {"odom_timeout": 5.0, "refinement_timeout": 1.0},
    "simulation": {"real_time_factor": 5.0, "command_wait": 2.0},
}


@pytest.fixture(scope="module")
def simulation(shared: tuple[Processes, Client]) -> Process:
    return shared[0].start("simulation", **SETTINGS["simulation"])


@pytest.fixture(scope="module")
def chains(shared: tuple[Processes, Client], simulation: Process) -> ChainClient:
    shared[0].start("executor", **SETTINGS["executor"])
    return ChainClient(shared[1])


@pytest.fixture(autouse=True)
def placed(chains: ChainClient) -> None:
    chains.place(Pose(-2.0, 0.0, 0.0))


def test_a_chain_runs_to_its_end_and_is_recorded(chains: ChainClient) -> None:
    before = len(chains.actions)
    sent = chains.send(chain_of_the_paper())
    result = sent.result()
    assert result.outcome.code == Outcome.SUCCEEDED, result.outcome.reason
    assert chains.ros.ball().x > 4.0 - 0.7
    chains.ros.eventually(lambda: len(chains.actions) == before + 3, "three records")
    records = chains.actions[before:]
    assert [record.action for record in records] == ["goToPose", "dribbleBall", "shoot"]
    assert [record.step for record in records] == [0, 1, 2]
    assert all(record.outcome.code == Outcome.SUCCEEDED for record in records)
    assert sum(record.actual.duration for record in records) == pytest.approx(
        result.record.actual.duration
    )
    assert records[1].start == records[0].end
    assert [record.header.stamp for record in result.record.actions] == [
        r.header.stamp for r in records
    ]
    assert {record.chain_id for record in records} == {result.record.chain_id}
    chains.ros.eventually(
        lambda: chains.chains and chains.chains[-1].chain_id == result.record.chain_id,
        "the chain's record",
    )
    assert sent.feedback[0].steps == 3
    elapsed = [message.elapsed for message in sent.feedback]
    assert elapsed == sorted(elapsed)
    assert {message.top for message in sent.feedback} == {"goToBall", "dribbleBall", "shoot"}
    assert all(message.status for message in sent.feedback)


def test_cancel_stops_the_robot_and_goals_have_the_status_that_clients_expect(
    chains: ChainClient,
) -> None:
    arrays = chains.ros.listen(
        GoalStatusArray, "execute_chain/_action/status", qos_profile_action_status_default
    )

    def last(sent: SentChain) -> int | None:
        found = [
            each
            for a in arrays
            for each in a.status_list
            if each.goal_info.goal_id == sent.handle.goal_id
        ]
        return found[-1].status if found else None

    driving = chains.send(PATROL)
    chains.wait_until_moving()
    chains.ros.eventually(lambda: last(driving) == GoalStatus.STATUS_EXECUTING, "executing")
    assert driving.cancel()
    assert driving.outcome().code == Outcome.CANCELED
    chains.ros.eventually(lambda: last(driving) == GoalStatus.STATUS_CANCELED, "canceled")
    chains.ros.eventually(chains.standing, "the robot stands")
    pose, time = chains.ros.robot().pose, chains.ros.time()
    chains.ros.eventually(lambda: chains.ros.time() > time + 2.0, "two seconds pass")
    assert chains.ros.robot().pose.distance(pose) < 0.03
    arrived = chains.send([call("goToPose", chains.ros.robot().pose)])
    chains.ros.eventually(lambda: last(arrived) == GoalStatus.STATUS_SUCCEEDED, "succeeded")


def test_status_and_markers_are_latched_for_late_subscribers(chains: ChainClient) -> None:
    sent = chains.send(PATROL)
    chains.wait_until_moving()
    paths = chains.ros.listen(Path, "planned_path", LATCHED)
    names = ("chain", "object", "scene")
    drawn = {name: chains.ros.listen(MarkerArray, f"{name}_markers", LATCHED) for name in names}
    chains.ros.eventually(lambda: paths and all(drawn.values()), "path, chain, objects and scene")
    end = paths[0].poses[-1].pose.position
    assert any(math.dist((end.x, end.y), (x, 1.5)) < 0.01 for x in (2.5, -2.5))
    assert 20 <= len(paths[0].poses) <= 60
    added = [marker.type for marker in drawn["chain"][0].markers if marker.action == Marker.ADD]
    assert added == [Marker.LINE_LIST] * (1 + len(PATROL))  # the path, and an arrow at each goal
    (ball,) = [marker for marker in drawn["object"][0].markers if marker.type == Marker.SPHERE]
    assert math.hypot(ball.pose.position.x, ball.pose.position.y) < 0.02
    assert {marker.header.frame_id for marker in drawn["scene"][0].markers} == {"odom"}
    assert sent.cancel()
    sent.outcome()
    chains.ros.eventually(lambda: not paths[-1].poses, "no path without a goal")
    chains.ros.eventually(lambda: len(drawn["chain"][-1].markers) == 1, "no chain without a goal")


@pytest.mark.parametrize(
    ("calls", "expected"),
    [
        ([call("dribbleBall", Pose(2.0, 0.0, 0.0))], "pre-condition of step 1 (dribbleBall) now"),
        (
            [call("goToPose", Pose(1.0, 0.0, 0.0)), call("shoot", Pose(4.0, 0.0, 0.0))],
            "step 2 (shoot)",
        ),
        ([], "chain.calls: expected 1 to 100 items, got 0"),
        ([call("fly", Pose(0.0, 0.0, 0.0))], "chain.calls[0].top: expected one of"),
        ([call("goToPose", Pose(math.nan, 0.0, 0.0))], "expected a finite number"),
        (
            [call("goToPose", Pose(1000.0, 0.0, 0.0))],
            "expected a place for the robot inside the fence",
        ),
    ],
)
def test_an_invalid_chain_is_rejected_with_a_reason(
    chains: ChainClient, calls: list, expected: str
) -> None:
    result = chains.send(calls).result()
    assert result.outcome.code == result.record.outcome.code == Outcome.REFUSED
    assert expected in result.outcome.reason
    assert not result.record.actions
    assert chains.ros.robot().pose.distance(Pose(-2.0, 0.0, 0.0)) < 0.02


def test_a_newer_goal_preempts(chains: ChainClient) -> None:
    older = chains.send(PATROL)
    chains.wait_until_moving()
    assert chains.send([]).outcome().code == Outcome.REFUSED
    assert not older.ended()
    newer = chains.send([call("goToPose", Pose(-0.5, -1.0, 0.0))])
    assert older.outcome().code == Outcome.PREEMPTED
    assert newer.outcome().code == Outcome.SUCCEEDED
    assert chains.ros.robot().pose.distance(Pose(-0.5, -1.0, 0.0)) < 0.06


def test_a_goal_succeeds_without_a_refinement_node(chains: ChainClient) -> None:
    result = chains.send([call("goToPose", Pose(-1.5, 0.0, 0.0))], refine=True).result()
    assert result.outcome.code == Outcome.SUCCEEDED
    assert not result.record.refined
    assert (
        "refinement failed: expected the service refine_subgoal within 0.5 s"
        in result.record.refinement
    )


@pytest.mark.long
def test_missing_odometry_stops_the_robot_and_a_new_goal_works(
    chains: ChainClient, simulation: Process
) -> None:
    sent = chains.send(PATROL)
    chains.wait_until_moving()
    simulation.send(signal.SIGSTOP)
    try:
        outcome = sent.outcome()
    finally:
        simulation.send(signal.SIGCONT)
    assert outcome.code == Outcome.INPUT_LOST
    assert "odom is missing" in outcome.reason
    chains.ros.eventually(lambda: chains.commands[-1].linear.x == 0.0, "a stop")
    chains.ros.eventually(chains.standing, "the robot stands")
    assert chains.send([call("goToPose", Pose(-1.0, 0.5, 0.0))]).outcome().code == Outcome.SUCCEEDED


def test_a_reset_ends_the_goal(chains: ChainClient) -> None:
    sent = chains.send(PATROL)
    chains.wait_until_moving()
    assert chains.ros.call(Trigger, "reset").success
    outcome = sent.outcome()
    assert outcome.code == Outcome.INPUT_LOST
    assert "time went back" in outcome.reason
    chains.ros.eventually(chains.standing, "the robot stands")


def test_health_is_published(chains: ChainClient) -> None:
    assert chains.send([call("goToPose", Pose(-1.8, 0.0, 0.0))]).outcome().code == Outcome.SUCCEEDED
    names = values_of(chains.ros.status_of("executor")).keys()
    assert {"odom", "last error", "99 % of the last 1000 ticks within (ms)"} <= names
