"""The node `executor` with chains whose variables are open, and a refinement that the test plays."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from chain_client import ChainClient, call
from conftest import Host, Start
from ros_client import Client

from ator_interfaces.msg import Outcome
from ator_interfaces.srv import RefineSubgoal
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of
from ator_ros.world.messages import pose_from

FILLED_IN = 0.9
"""Heading in rad that refinement fills in where the chain leaves it open."""
Answer = Callable[[RefineSubgoal.Request, RefineSubgoal.Response], RefineSubgoal.Response]


def left_alone(request: RefineSubgoal.Request, response: RefineSubgoal.Response) -> RefineSubgoal.Response:
    """Answer as a closed gate does: not refined, what was open filled in."""
    response.accepted, response.chain, response.reason = True, request.chain, "the gate is closed"
    step = response.chain.calls[0]
    assert list(step.open) == ["yaw"]
    place = pose_from(step.goal.pose, "goal")
    step.goal.pose, step.open = pose_of(place._replace(yaw=FILLED_IN)), []
    return response


def refused(request: RefineSubgoal.Request, response: RefineSubgoal.Response) -> RefineSubgoal.Response:
    """Answer that the request cannot be evaluated."""
    response.chain, response.reason = request.chain, "no model"
    return response


@pytest.mark.parametrize(
    ("answer", "yaw", "reason"),
    [
        (left_alone, FILLED_IN, "the gate is closed"),
        (refused, 0.0, "executed as sent, refinement failed: no model"),
    ],
)
def test_what_is_open_is_driven_as_refinement_fills_it_in(
    start: Start, host: Host, client: Client, answer: Answer, yaw: float, reason: str
) -> None:
    start("simulation", real_time_factor=2.0)
    client.node.create_service(RefineSubgoal, "refine_subgoal", answer)
    host("executor", odom_timeout=5.0, start_timeout=60.0, refinement_timeout=30.0)
    client.place(robot=Pose(-1.2, 0.0, 0.0), ball=(0.0, 0.0))
    step = call("goToBall", Pose(0.0, 0.0, 0.0), opened=("yaw",))
    result = ChainClient(client).send([step], refine=True).result()
    record = result.record
    assert result.outcome.code == Outcome.SUCCEEDED, result.outcome.reason
    assert (record.refined, record.refinement) == (False, reason)
    assert pose_from(record.chain.calls[0].goal.pose, "goal").yaw == pytest.approx(yaw)
    assert math.remainder(pose_from(record.actions[0].end.robot, "end").yaw - yaw, math.tau) == pytest.approx(
        0.0, abs=0.15
    )
