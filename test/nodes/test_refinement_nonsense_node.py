"""Nonsense that is sent to the node `refinement` is refused in words, and the node goes on."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import Any

import pytest
from process import Process, Processes
from refinement_requests import call, refine, request_of_the_paper
from ros_client import Client

from ator_interfaces.srv import RefineSubgoal
from ator_ros.geometry import Pose
from ator_ros.nodes.network import free_domain

pytestmark = pytest.mark.node


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Process, Client]]:
    """Yield a node with the shipped models, and a client of it."""
    with free_domain() as domain:
        processes, client = Processes(domain, tmp_path_factory.mktemp("logs")), Client(domain)
        yield processes.start("refinement", deadline=20.0), client
        client.close()
        processes.kill()


def nan_position(request: RefineSubgoal.Request) -> None:
    request.situation.robot.position.x = math.nan


def zero_quaternion(request: RefineSubgoal.Request) -> None:
    request.chain.calls[1].goal.pose.orientation.w = 0.0
    request.chain.calls[1].goal.pose.orientation.z = 0.0


def unknown_top(request: RefineSubgoal.Request) -> None:
    request.chain.calls[0].top = "fly"


def wrong_frame(request: RefineSubgoal.Request) -> None:
    request.chain.calls[0].goal.header.frame_id = "moon"


def empty_chain(request: RefineSubgoal.Request) -> None:
    request.chain.calls = []


def enormous_chain(request: RefineSubgoal.Request) -> None:
    request.chain.calls = [call("goToPose", Pose(0.0, 0.0, 0.0))] * 5000


def negative_weight(request: RefineSubgoal.Request) -> None:
    request.objective.accuracy = -1.0


def no_weight(request: RefineSubgoal.Request) -> None:
    request.objective.duration = 0.0
    request.objective.success = 0.0


def unknown_set(request: RefineSubgoal.Request) -> None:
    request.chain.action_set = "../../etc"


def unknown_variable(request: RefineSubgoal.Request) -> None:
    request.chain.calls[0].open = ["heading"]


def ball_elsewhere(request: RefineSubgoal.Request) -> None:
    request.situation.objects[0].position.x = 1.0


def ball_unknown(request: RefineSubgoal.Request) -> None:
    request.situation.objects = []


NONSENSE = {
    nan_position: "situation.robot.position.x: expected a finite number from -100000000 to",
    zero_quaternion: "chain.calls[1].goal.pose.orientation: expected a quaternion (x, y, z, w) with a",
    unknown_top: "chain.calls[0].top: expected one of ['dribbleBall', 'goToBall', ",
    wrong_frame: "chain.calls[0].goal.header.frame_id: expected the frame 'odom', got 'moon'",
    empty_chain: "chain.calls: expected 1 to 32 items, got 0",
    enormous_chain: "chain.calls: expected 1 to 32 items, got 5000",
    negative_weight: "objective: expected a weight of accuracy that is 0 or from 1e-06 to 1e+06, got -1",
    no_weight: "objective: expected at least one weight above 0, got none",
    unknown_set: "chain.action_set: expected one of",
    unknown_variable: "chain.calls[0].open: expected names of ['*', 'speed', 'x', 'y', 'yaw'], each once",
    ball_elsewhere: "step 1 (goToBall) now: expected ball.x within 0.1 of goal.x, it is 1 off",
    ball_unknown: "step 1 (goToBall) now: expected ball.x near goal.x, but one of them is unknown",
}


@pytest.mark.parametrize("change", NONSENSE, ids=lambda change: change.__name__)
def test_nonsense_is_refused_and_the_node_goes_on(shared: tuple[Process, Client], change: Any) -> None:
    node, client = shared
    request = request_of_the_paper()
    change(request)
    response = refine(client, request)
    assert not response.accepted
    assert not response.refined
    assert NONSENSE[change] in response.reason
    assert len(response.chain.calls) == (0 if change is enormous_chain else len(request.chain.calls))
    assert refine(client, request_of_the_paper(yaw=3.0)).accepted
    assert "Traceback" not in node.output


def test_a_flood_of_nonsense_is_told_now_and_then_and_counted(shared: tuple[Process, Client]) -> None:
    node, client = shared
    told, request = node.output.count("refused: "), request_of_the_paper()
    unknown_top(request)
    began = time.monotonic()
    for _ in range(100):
        assert not refine(client, request).accepted
    most = 1 + (time.monotonic() - began) / 2.0  # a warning in two seconds
    assert 0 <= node.output.count("refused: ") - told <= most + 1
