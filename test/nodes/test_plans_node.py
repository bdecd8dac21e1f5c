"""Plans from goals through ROS: the service plan_chains, and what is wanted in a goal of execute_chain."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from chain_client import ChainClient, call
from conftest import Host, Start
from nav_msgs.msg import Odometry
from refinement_requests import save_small_models
from ros_client import Client

from ator_interfaces.msg import GoalTerm, ObjectState, Outcome, PlanGoal
from ator_interfaces.srv import PlanChains
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of
from ator_ros.nodes.qos import SENSOR_DATA

pytestmark = pytest.mark.node


ROLLING = PlanGoal(terms=[GoalTerm(variable="ball.vx", value=1.0, low=-0.1, high=0.1)])
"""What no TOP achieves."""


def asked(goal: PlanGoal) -> PlanChains.Request:
    request = PlanChains.Request(goal=goal)
    request.situation.robot = pose_of(Pose(-2.0, 1.0, 0.0))
    request.situation.objects = [ObjectState(name="ball")]
    return request


def many(terms: int) -> PlanGoal:
    return PlanGoal(terms=[GoalTerm(variable="ball.x")] * terms)


def test_a_goal_is_planned_and_what_cannot_be_is_refused(
    start: Start, client: Client, tmp_path: Path
) -> None:
    save_small_models(tmp_path)
    start("refinement", models=tmp_path)

    def told(goal: PlanGoal) -> PlanChains.Response:
        return client.call(PlanChains, "plan_chains", asked(goal))

    planned = told(PlanGoal(name="ball_in_goal"))
    assert planned.accepted, planned.reason
    steps = [[step.top for step in chain.calls] for chain in planned.chains]
    assert steps == [["goToBall", "dribbleBall", "shoot"]]
    assert list(planned.chains[0].calls[0].open) == ["speed", "yaw"]
    assert planned.chains[0].calls[0].goal.header.frame_id == "odom"
    assert told(PlanGoal(terms=[GoalTerm(variable="ball.x", low=-1.0, high=1.0)])).holds
    for goal, reason in (
        (PlanGoal(name="ball_in_basket"), "goal.name: expected one of ['ball_held', 'ball_in_goal']"),
        (PlanGoal(), "goal.terms: expected 1 to 8 items, got 0"),
        (many(9), "goal.terms: expected 1 to 8 items, got 9"),
        (PlanGoal(terms=[GoalTerm(variable="cup.x")]), "goal.terms[0].variable: expected one of"),
        (ROLLING, "no TOP achieves ball.vx"),
        (PlanGoal(terms=[GoalTerm(variable="ball.x", low=1.0)]), "expected low <= high"),
        (PlanGoal(terms=[GoalTerm(variable="ball.x", value=float("nan"))]), "expected a finite number"),
    ):  # fmt: skip
        answer = told(goal)
        assert not answer.accepted
        assert reason in answer.reason


@pytest.fixture
def playing(start: Start, host: Host, client: Client, tmp_path: Path) -> Callable[[], ChainClient]:
    """Return a function that starts all nodes, and a client of the executor."""

    def started() -> ChainClient:
        start("simulation", real_time_factor=4.0)
        save_small_models(tmp_path)
        start("refinement", models=tmp_path)
        settings = {"odom_timeout": 5.0, "start_timeout": 60.0, "refinement_timeout": 30.0}
        host("executor", plan_timeout=120.0, **settings)
        client.place(robot=Pose(-1.2, 0.0, 0.0), ball=(0.0, 0.0))
        return ChainClient(client)

    return started


def test_a_goal_that_says_what_is_wanted_is_planned_refined_and_executed(
    playing: Callable[[], ChainClient],
) -> None:
    chains = playing()
    held = chains.send([], wanted=PlanGoal(name="ball_held"), refine=True).result()
    assert held.outcome.code == Outcome.SUCCEEDED, held.outcome.reason
    assert [step.top for step in held.record.chain.calls] == ["goToBall"]
    again = chains.send([], wanted=PlanGoal(name="ball_held")).result()
    assert again.outcome.code == Outcome.SUCCEEDED
    assert again.outcome.reason == "the goal holds already"
    for wanted, steps, reason in (
        (ROLLING, [], "no TOP achieves ball.vx"),
        (PlanGoal(name="ball_held"), [call("goToPose", Pose(1.0, 0.0, 0.0))], "expected no chain beside it"),
    ):  # fmt: skip
        outcome = chains.send(steps, wanted=wanted).result().outcome
        assert outcome.code == Outcome.REFUSED
        assert reason in outcome.reason


def test_a_goal_that_waits_for_its_plan_can_be_canceled_and_is_given_up_in_time(
    start: Start, host: Host, client: Client
) -> None:
    start("simulation", real_time_factor=4.0)
    host("executor", odom_timeout=5.0, plan_timeout=3.0)  # without a node that plans
    states = client.listen(Odometry, "odom", SENSOR_DATA)
    client.eventually(lambda: states, "odometry")
    chains = ChainClient(client)
    sent = chains.send([], wanted=PlanGoal(name="ball_held"))
    sent.cancel()
    assert sent.result().outcome.code == Outcome.CANCELED
    late = chains.send([], wanted=PlanGoal(name="ball_held")).result().outcome
    assert late.code == Outcome.REFUSED
    assert late.reason == "no plan: expected the service plan_chains in time, got none"
