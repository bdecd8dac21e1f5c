"""Maps on running nodes: from a topic, each replaced by the next.

Goals in walls; a drive through a door.
"""

import math
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from chain_client import ChainClient, call
from conftest import Host, Start
from diagnostic_msgs.msg import DiagnosticStatus
from experience_rows import route_drives
from maps import hall_map
from nav_msgs.msg import OccupancyGrid
from process import PATIENCE
from refinement_requests import refine
from ros_client import Client

from ator_interfaces.msg import Outcome, TopCall
from ator_interfaces.srv import PredictDurations, RefineSubgoal
from ator_ros.domains.domain import find_domain
from ator_ros.geometry import Pose
from ator_ros.nodes import refinement
from ator_ros.nodes.maps import FollowedMap
from ator_ros.nodes.messages import occupancy_grid_of, pose_of
from ator_ros.nodes.qos import LATCHED
from ator_ros.performance.model_file import save_model
from ator_ros.performance.training import train
from ator_ros.refinement.step_durations import Durations, DurationTable
from ator_ros.world.grid_map import GridMap

pytestmark = pytest.mark.node
BUILDING = find_domain("building")
WALL = hall_map("/map")
EMPTY = hall_map("/map", wall=False)


@pytest.fixture
def models(tmp_path: Path) -> Path:
    """Return a folder with a model that was learned on the hall with a wall."""
    domain = find_domain("pursuit").on_map(WALL)
    robot = domain.robot()
    rows = route_drives(robot, 120, seed=1).assign(action="pursue")
    save_model(
        tmp_path / "pursue.json", train("pursue", rows, robot, features=domain.candidates("pursue"))
    )
    return tmp_path


def request(*calls: TopCall) -> RefineSubgoal.Request:
    sent = RefineSubgoal.Request()
    sent.situation.robot = pose_of(Pose(-3.0, 0.0, 0.0))
    sent.chain.calls = list(calls)
    return sent


def test_a_new_map_replaces_the_old_one_and_answers_name_theirs(
    host: Host, client: Client, models: Path
) -> None:
    maps = client.node.create_publisher(OccupancyGrid, "map", LATCHED)
    node = host(
        "refinement", domain="pursuit", models=models, map="/map", frame="map", deadline=20.0
    )
    sent = request(
        call("visit", Pose(3.0, 0.0, 0.0), opened=("yaw",)),
        call("visit", Pose(3.0, 3.0, math.pi / 2)),
    )
    answer = refine(client, sent)
    assert not answer.accepted
    assert "/map: expected a map, got none yet; start map_server" in answer.reason
    durations = []
    for grid in (WALL, EMPTY):
        maps.publish(occupancy_grid_of(grid, frame="map"))
        client.eventually(
            lambda name=str(grid): f"map {name}" in (refine(client, sent).reason),
            f"answers on the map {grid}",
        )
        answer = refine(client, sent)
        assert answer.accepted, answer.reason
        durations.append(answer.after.duration)
    assert durations[0] > durations[1] + 2.0
    narrow = GridMap("/map", np.eye(100, dtype=bool), 0.05, Pose(0.0, 0.0, 0.0))
    maps.publish(occupancy_grid_of(narrow, frame="map"))
    client.eventually(
        lambda: "ignored: /map: expected a place 0.17 m from obstacles, got none" in node.output,
        "a warning of a map without room",
    )
    assert refine(client, sent).accepted
    maps.publish(occupancy_grid_of(WALL, frame="attic"))
    maps.publish(occupancy_grid_of(WALL, frame="map"))
    inside = request(call("visit", Pose(0.0, 0.0, 0.0)))
    client.eventually(lambda: not refine(client, inside).accepted, "the wall again")
    assert "expected a place in free space, 0.17 m from obstacles, on the map /map (" in (
        refine(client, inside).reason
    )


def test_all_durations_of_a_request_are_predicted_on_one_map(
    host: Host, client: Client, models: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    has_begun = threading.Event()

    used: list[object] = []  # models; each map has its own

    class SlowTable(DurationTable):
        def __init__(self, worlds: Any, calls: Any, models: Any) -> None:
            super().__init__(worlds, calls, models)
            used.append(models)

        def part(self, column: int, first: int, last: int) -> Durations:
            has_begun.set()
            time.sleep(0.05)  # as with a slow planner: a request takes 2 s
            return super().part(column, first, last)

    monkeypatch.setattr(refinement, "DurationTable", SlowTable)
    maps = client.node.create_publisher(OccupancyGrid, "map", LATCHED)
    host("refinement", domain="pursuit", models=models, map="/map", frame="map")
    durations = client.node.create_client(PredictDurations, "predict_durations")
    assert durations.wait_for_service(timeout_sec=PATIENCE)
    sent = request(call("visit", Pose(3.0, 0.0, 0.0)))

    def switch(grid: GridMap) -> None:
        maps.publish(occupancy_grid_of(grid, frame="map"))
        client.eventually(lambda: f"map {grid}" in refine(client, sent).reason, f"the map {grid}")

    switch(WALL)
    future = durations.call_async(
        PredictDurations.Request(situations=[sent.situation] * 60, calls=sent.chain.calls)
    )
    assert has_begun.wait(PATIENCE)
    switch(EMPTY)
    assert not future.done()
    answer = client.eventually(future.result, "the durations")
    assert f"map {WALL}" in answer.reason
    assert len(used) == 1
    assert len(set(answer.durations)) == 1


def test_the_executor_refuses_a_goal_in_a_wall_before_the_robot_moves(
    host: Host, client: Client
) -> None:
    maps = client.node.create_publisher(OccupancyGrid, "map", LATCHED)
    node = host("executor", domain="building", map="map")
    maps.publish(occupancy_grid_of(EMPTY, frame="odom"))
    maps.publish(occupancy_grid_of(WALL, frame="odom"))
    client.eventually(
        lambda: f"on the map map ({str(WALL).rpartition('(')[2]}" in node.output, "the map"
    )
    chains = ChainClient(client)
    outcome = chains.send(
        [call("visit", Pose(-2.0, 0.0, 0.0)), call("visit", Pose(0.0, 0.0, 0.0))]
    ).outcome()
    assert outcome.code == Outcome.REFUSED
    assert "chain.calls[1].goal (visit): expected a place in free space" in outcome.reason
    assert not chains.commands


def test_goals_are_refused_while_the_map_that_was_asked_for_is_unusable(
    host: Host, client: Client
) -> None:
    maps = client.node.create_publisher(OccupancyGrid, "map", LATCHED)
    node = host("executor", domain="building", map="map")
    chains = ChainClient(client)
    there = [call("visit", Pose(-2.0, 0.0, 0.0))]
    outcome = chains.send(there).outcome()
    assert outcome.code == Outcome.REFUSED
    assert "map: expected a map, got none yet; start map_server" in outcome.reason
    continuous = occupancy_grid_of(WALL, frame="odom")
    shades = np.where(WALL.free, 30, 97).astype(np.int8)
    shades[::3, ::3] = 8
    continuous.data = shades.ravel().tolist()
    maps.publish(continuous)
    found = "its cells have values from 8 to 97, free are 0 to 25"
    client.eventually(lambda: found in node.output, "a warning")
    status = client.status_of("executor")
    assert status.level == DiagnosticStatus.ERROR
    assert found in status.message
    refused = chains.send(there).outcome()
    assert refused.code == Outcome.REFUSED
    assert found in refused.reason
    assert "map: expected a place 0.17 m from obstacles, got none" in refused.reason
    assert len(refused.reason) <= 300
    assert not chains.commands
    maps.publish(occupancy_grid_of(WALL, frame="odom"))
    client.eventually(lambda: "on the map map (" in node.output, "the map")
    inside = chains.send([call("visit", Pose(0.0, 0.0, 0.0))]).outcome()
    assert "expected a place in free space" in inside.reason
    maps.publish(continuous)
    health = client.statuses()
    client.eventually(
        lambda: any("the previous map is used" in status.message for status in health),
        "diagnostics of a map that is not used",
    )


def test_a_map_is_used_once_the_node_is_idle_unless_it_has_no_room(client: Client) -> None:
    taken, busy = list[GridMap | None](), iter((False,) * 4)
    FollowedMap(
        client.node,
        {"map": "walls"},
        BUILDING,
        BUILDING.robot(),
        lambda domain, _: taken.append(domain.grid),
        lambda: next(busy, True),
    )
    maps = client.node.create_publisher(OccupancyGrid, "walls", LATCHED)
    for grid in (WALL, EMPTY):
        maps.publish(occupancy_grid_of(grid, frame="map"))
    client.eventually(lambda: taken, "the newest map")
    narrow = np.zeros(EMPTY.free.shape, dtype=bool)
    narrow[9, 9] = True
    maps.publish(occupancy_grid_of(GridMap("narrow", narrow, 0.05, EMPTY.origin), frame="map"))
    maps.publish(occupancy_grid_of(WALL, frame="map"))
    client.eventually(lambda: len(taken) == 2, "the next map")
    assert [str(grid).rpartition("(")[2] for grid in taken] == [
        str(grid).rpartition("(")[2] for grid in (EMPTY, WALL)
    ]


@pytest.mark.long
def test_a_tour_of_the_building_is_driven_by_its_server(start: Start, client: Client) -> None:
    start(
        "simulation",
        domain="building",
        real_time_factor=0.0,
        command_wait=1.0,
        robot_start=[-6.2, 3.0, 0.0],
    )
    server = start("pursuit_server")
    executor = start("executor", domain="building", odom_timeout=2.0)
    client.eventually(lambda: "ready for chains" in executor.output, "the executor", 60.0)
    client.eventually(lambda: "planning on a map" in server.output, "the server", 60.0)
    outcome = ChainClient(client).send([call("visit", Pose(-6.2, -0.2, 0.0))]).outcome()
    assert outcome.code == Outcome.SUCCEEDED, outcome.reason
    assert client.robot().pose.distance(Pose(-6.2, -0.2, 0.0)) < 0.2
