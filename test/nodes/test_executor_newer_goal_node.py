"""A newer goal while another one is under way, waits for its plan, or the executor ends."""

from __future__ import annotations

import time

import pytest
from chain_client import ChainClient, call
from conftest import Host
from hall import Base, Hall
from hosted import Hosted
from ros_client import Client

from ator_interfaces.msg import GoalTerm, Outcome, PlanGoal
from ator_interfaces.srv import PlanChains
from ator_ros.geometry import Pose
from ator_ros.nodes.qos import SERVICES
from ator_ros.world.state import RobotState

WANTED = PlanGoal(terms=[GoalTerm(variable="robot.x", value=0.0, tolerance=0.5)])


def planner(hall: Hall) -> list[PlanChains.Request]:
    """Answer that what is wanted holds, whatever it is; return the requests."""
    asked: list[PlanChains.Request] = []

    def plan(request: PlanChains.Request, response: PlanChains.Response) -> PlanChains.Response:
        asked.append(request)
        response.accepted = response.holds = True
        return response

    node = hall.client.node
    hall.client.within(lambda: node.create_service(PlanChains, "plan_chains", plan, qos_profile=SERVICES))
    return asked


@pytest.fixture
def hosted(host: Host) -> Hosted:
    return host("executor", odom_timeout=2.0)


@pytest.mark.usefixtures("hosted")
def test_after_a_preemption_silence_is_noticed_as_soon_as_before(client: Client) -> None:
    base, chains = Base(client), ChainClient(client)
    chains.send([call("goToPose", Pose(1.0, 0.0, 0.0))])
    time.sleep(0.1)
    newer = chains.send([call("goToPose", Pose(1.0, 0.5, 0.0))])
    before = len(chains.commands)
    client.eventually(lambda: len(chains.commands) > before + 5, "commands for the newer one")
    base.close()
    before = len(chains.commands)
    assert newer.outcome().code == Outcome.INPUT_LOST
    stops = chains.commands[before:]
    assert len(stops) > 10  # one every 0.05 s, where it is watched closely


def test_what_holds_while_the_robot_drives_is_asked_for_again_when_it_stands(hall: Hall) -> None:
    asked = planner(hall)
    hall.base.state = RobotState(Pose(0.0, 0.0, 0.0), v=0.5)
    sent = hall.chains.send([], wanted=WANTED)
    hall.client.eventually(lambda: asked, "a request")
    time.sleep(0.3)
    assert not sent.ended()
    assert len(asked) == 1
    hall.base.state = RobotState(Pose(0.2, 0.0, 0.0))
    assert sent.outcome().reason == "the goal holds already"
    assert len(asked) == 2


def test_a_goal_that_cannot_be_read_leaves_the_one_that_waits_for_its_plan(hall: Hall) -> None:
    waiting = hall.chains.send([], wanted=WANTED)  # without a node that plans
    unknown = hall.chains.send([call("fetch", Pose(1.0, 0.0, 0.0))])
    assert unknown.outcome().code == Outcome.REFUSED
    beside = hall.chains.send([call("visit", Pose(1.0, 0.0, 0.0))], wanted=WANTED)
    assert beside.outcome().code == Outcome.REFUSED
    assert not waiting.ended()
    hall.chains.send([call("visit", Pose(1.0, 0.5, 0.3))])
    assert waiting.outcome().code == Outcome.PREEMPTED


def test_a_goal_that_comes_while_the_node_ends_is_rejected(hosted: Hosted, client: Client) -> None:
    base, chains = Base(client), ChainClient(client)
    client.robot()
    hosted.node._stopping = True  # as `stop` does first
    with pytest.raises(AssertionError):
        chains.send([call("goToPose", Pose(1.0, 0.0, 0.0))])
    assert not chains.commands
    base.close()


def test_what_holds_is_not_believed_of_a_robot_that_a_server_still_moves(hall: Hall) -> None:
    asked, server = planner(hall), hall.serve(cancels=False)
    hall.chains.send([call("visit", Pose(1.0, 0.5, 0.3))])
    hall.client.eventually(lambda: server.goals, "a goal")
    sent = hall.chains.send([], wanted=WANTED)
    hall.client.eventually(lambda: server.canceled, "a cancellation")
    assert not sent.ended()
    assert sent.outcome().code == Outcome.SUCCEEDED  # once the server's time to end is over
    assert len(asked) == 2


def test_a_robot_that_is_halted_is_told_to_stand_until_it_does(hall: Hall) -> None:
    planner(hall)
    hall.base.state = RobotState(Pose(0.0, 0.0, 0.0), v=0.5)
    sent = hall.chains.send([], wanted=WANTED)
    hall.client.eventually(lambda: len(hall.chains.commands) > 5, "commands to stand")
    assert all(command.linear.x == 0.0 for command in hall.chains.commands)
    hall.base.close()
    outcome = sent.outcome()
    assert (outcome.code, outcome.reason[:15]) == (Outcome.INPUT_LOST, "odom is missing")
