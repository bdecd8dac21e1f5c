"""Stations that are passed without a stop, with the nodes and the server of the domain patrol.

The server takes newer goals while it drives, or drives through several.
"""

import importlib
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from arena import LONG_START
from chain_client import ChainClient
from geometry_msgs.msg import PoseStamped
from nav2_interfaces import provide_nav2_msgs
from process import PATIENCE, Processes
from rclpy.action import ActionClient
from ros_client import Client, SentGoal

from ator_interfaces.msg import Outcome, TopCall
from ator_ros.domains.domain import find_domain
from ator_ros.experience.table import read_experience
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of
from ator_ros.resources import resource_path
from ator_ros.tools.collect import main

pytestmark = [pytest.mark.node, pytest.mark.long]

START = Pose(-2.0, 0.0, 0.0)
STATIONS = [Pose(0.0, 0.0, 3.0), Pose(1.5, 0.6, -2.0), Pose(3.0, 0.0, 0.0)]


THROUGH = str(resource_path("config", "patrol", "through.yaml"))


@pytest.fixture(scope="module", params=["patrol", THROUGH])
def declared(request: pytest.FixtureRequest) -> str:
    """Return the domain."""
    return str(request.param)


@pytest.fixture(scope="module")
def nodes(shared: tuple[Processes, Client], declared: str) -> Iterator[tuple[Client, ChainClient]]:
    processes, client = shared
    with pytest.MonkeyPatch.context() as patch:
        provide_nav2_msgs(patch)
        started = {
            "simulating": processes.start(
                "simulation", domain=declared, real_time_factor=5.0, command_wait=0.5
            ),
            "": processes.start("pursuit_server"),
            "ready for chains": processes.start("executor", domain=declared, odom_timeout=2.0),
            "become chains": processes.start("waypoints", domain=declared),
        }
        for words, node in started.items():
            client.eventually(
                lambda n=node, w=words: w in n.output, f"{node.name} is ready", LONG_START
            )
        chains = ChainClient(client)
        client.eventually(lambda: client.robots, "odometry")
        chains.wait_for_publishers()
        yield client, chains
    processes.kill()


@pytest.fixture
def chains(nodes: tuple[Client, ChainClient]) -> ChainClient:
    """Return the client of chains, with the robot at the start."""
    client, found = nodes
    client.place(robot=START)
    client.eventually(
        lambda: client.robot().pose.distance(START) < 0.1 and found.standing(), "at the start"
    )
    found.chains.clear()
    found.actions.clear()
    return found


def visits(*passing: bool) -> list[TopCall]:
    calls = [TopCall(top="visit", passing=passes) for passes in passing]
    for call, pose in zip(calls, STATIONS, strict=True):
        call.goal.pose = pose_of(pose)
    return calls


def test_the_robot_drives_on_where_it_passes(chains: ChainClient, declared: str) -> None:
    (top,) = find_domain(declared).tops
    record = chains.send(visits(True, True, False)).result().record
    assert record.outcome.code == record.outcome.SUCCEEDED, record.outcome.reason
    assert [action.stopped for action in record.actions] == [False, False, True]
    for action, pose in zip(record.actions, STATIONS, strict=True):
        end = action.end.robot.position
        assert abs(end.x - pose.x) <= top.place_tolerance
        assert abs(end.y - pose.y) <= top.place_tolerance
        left = math.hypot(end.x - pose.x, end.y - pose.y)
        # The robot still drives on when the next leg begins.
        nearest = left if action.stopped else left - 0.1
        assert action.actual.accuracy <= nearest + 1e-9
    assert all(action.start.vx > 0.2 for action in record.actions[1:])
    assert [call.passing for call in record.chain.calls] == [True, True, False]


def test_a_chain_that_would_end_in_passing_is_refused(chains: ChainClient) -> None:
    outcome = chains.send(visits(False, False, True)).result().outcome
    assert outcome.code == outcome.REFUSED
    assert "the last step of a chain must stop" in outcome.reason


def test_a_canceled_chain_stops_the_robot_that_drives_on(chains: ChainClient) -> None:
    sent = chains.send(visits(True, True, False))
    chains.ros.eventually(lambda: chains.actions, "the first station was passed")
    assert sent.cancel()
    assert sent.outcome().code == Outcome.CANCELED
    chains.ros.eventually(chains.standing, "the robot stands")
    place = chains.ros.robot().pose
    chains.wait_for_newer_odometry()
    assert chains.ros.robot().pose.distance(place) < 0.02


def test_a_newer_goal_takes_over_from_a_run(chains: ChainClient) -> None:
    sent = chains.send(visits(True, True, False))
    chains.ros.eventually(lambda: chains.actions, "the first station was passed")
    newer = TopCall(top="visit")
    newer.goal.pose = pose_of(START)
    newest = chains.send([newer])
    former = sent.result().record
    assert former.outcome.code == Outcome.PREEMPTED
    steps = [(action.step, action.outcome.code) for action in former.actions]
    assert steps == [(0, Outcome.SUCCEEDED), (1, Outcome.PREEMPTED)]
    assert newest.outcome().code == Outcome.SUCCEEDED
    chains.ros.eventually(chains.standing, "the robot stands")
    assert chains.ros.robot().pose.distance(START) < 0.3


def test_legs_of_both_kinds_are_collected_with_the_running_executor(
    chains: ChainClient, declared: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(chains.ros.domain))
    table = tmp_path / "legs.parquet"
    words = ["--domain", declared, "--over-ros", "--attach", "--yes", "--seed", "3"]
    assert main([*words, "--episodes", "4", "--out", str(table)]) == 0
    legs = read_experience(table).frame
    assert legs["success"].all()
    assert legs["stopg"].tolist()[-1] == 1.0
    assert set(legs["stopg"]) == {0.0, 1.0}
    moving = legs["v"].to_numpy()[1:] > 0.2
    assert (moving == (legs["stopg"].to_numpy()[:-1] == 0.0)).all()


@pytest.mark.parametrize(
    ("kind", "passing", "opened"),
    [
        ("NavigateThroughPoses", "through_poses", True),
        ("NavigateThroughPoses", "never", False),
        ("FollowWaypoints", "through_poses", False),
        ("FollowWaypoints", "always", True),
    ],
)
def test_waypoints_leave_the_stops_open(
    chains: ChainClient, kind: str, passing: str, opened: bool
) -> None:
    client = chains.ros
    client.set_parameters("waypoints", passing=passing)
    name = {"NavigateThroughPoses": "navigate_through_poses"}.get(kind, "follow_waypoints")
    action: Any = getattr(importlib.import_module("nav2_msgs.action"), kind)
    server = ActionClient(client.node, action, f"waypoints/{name}")
    assert server.wait_for_server(timeout_sec=PATIENCE)
    client.wait_for_discovery_by(f"waypoints/{name}")
    poses = [PoseStamped(pose=pose_of(pose)) for pose in (STATIONS[0], STATIONS[1])]
    for pose in poses:
        pose.header.frame_id = "odom"
    sent = SentGoal(client, server, action.Goal(poses=poses))
    chains.wait_until_moving()
    sent.cancel()
    client.eventually(lambda: chains.chains, "the record of the chain")
    names = [set(call.open) for call in chains.chains[-1].chain.calls]
    assert names == [{"yaw", "stop"} if opened else {"yaw"}, set()]
    passing = [call.passing for call in chains.chains[-1].chain.calls]
    assert passing == [opened and kind == "NavigateThroughPoses", False]
