"""The `refinement` node over its ROS interfaces."""

import math
from pathlib import Path

import numpy as np
import pytest
from chain_client import call
from conftest import Host
from diagnostic_msgs.msg import DiagnosticStatus
from experience_rows import uncertain
from process import Processes
from refinement_requests import refine, request_of_the_paper, save_small_models
from ros_client import Client
from visualization_msgs.msg import MarkerArray

from ator_interfaces.msg import GoalTerm, PlanGoal, Situation, TopCall
from ator_interfaces.srv import PlanChains, PredictDurations, RefineSubgoal
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of
from ator_ros.nodes.qos import LATCHED
from ator_ros.refinement.refiner import LONGEST_CHAIN


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("models")
    save_small_models(folder)
    return folder


@pytest.fixture(scope="module")
def service_client(shared: tuple[Processes, Client], models: Path) -> Client:
    """Return a client of a node with default settings, which several tests share."""
    shared[0].start("refinement", models=models, deadline=20.0)
    return shared[1]


def test_the_free_angle_is_refined(service_client: Client) -> None:
    response = refine(service_client, request_of_the_paper(yaw=3.0))
    assert response.accepted
    assert response.refined
    assert [(free.subgoal, free.name) for free in response.free] == [(0, "yaw")]
    assert response.free[0].before == pytest.approx(3.0)
    assert response.cost_after == pytest.approx(response.after.duration)
    assert response.after.duration < response.before.duration
    assert response.after.duration == pytest.approx(sum(a.duration for a in response.after_actions))
    assert response.chain.calls[0].goal.pose != response.original.calls[0].goal.pose
    assert response.chain.calls[1] == response.original.calls[1]
    (curve,) = response.curves
    assert list(curve.variables) == ["yaw"]
    assert len(curve.values) == len(curve.totals) >= 24
    assert min(curve.totals) >= response.cost_after - 1e-9


def test_an_open_angle_is_compared_with_the_fastest_approach(service_client: Client) -> None:
    responses = []
    for placeholder in (0.0, 3.0):
        request = request_of_the_paper(yaw=placeholder)
        request.as_given = False
        responses.append(refine(service_client, request))
    first, second = responses
    assert first.accepted
    assert (first.chain, first.original, first.free) == (second.chain, second.original, second.free)
    assert first.free[0].before != pytest.approx(3.0)
    assert first.after.duration <= first.before.duration


def test_startup_parameters_are_read_only(service_client: Client) -> None:
    results = service_client.set_parameters("refinement", models="/etc", frame="attic")
    assert [result.successful for result in results] == [False] * 2
    assert all("read-only" in result.reason for result in results)


def test_the_gate_can_be_disabled_at_runtime(host: Host, client: Client, tmp_path: Path) -> None:
    save_small_models(tmp_path, uncertain)
    host("refinement", models=tmp_path, deadline=20.0)
    request = request_of_the_paper(yaw=3.0)
    assert not refine(client, request).refined
    for gate in (False, True):
        assert [result.successful for result in client.set_parameters("refinement", gate=gate)] == [
            True
        ]
        assert refine(client, request).refined is not gate


def test_the_failure_cost_is_the_parameter_unless_requested(
    host: Host, client: Client, models: Path
) -> None:
    host("refinement", models=models, deadline=20.0)
    request = request_of_the_paper(yaw=3.0)
    request.objective.success = 100.0
    by_request = refine(client, request).cost_before
    request.objective.success = -1.0
    assert refine(client, request).cost_before < by_request
    assert [
        each.successful for each in client.set_parameters("refinement", failure_cost=100.0)
    ] == [True]
    assert refine(client, request).cost_before == pytest.approx(by_request)


def test_without_learned_models_it_predicts_path_times_and_says_so(
    host: Host, client: Client, tmp_path: Path
) -> None:
    health = client.statuses()
    node = host("refinement", models=tmp_path)
    remark = "path times of goToPose, dribbleBall, as no drives are known yet"
    response = refine(client, request_of_the_paper())
    assert response.accepted
    assert remark in response.reason
    assert math.isfinite(response.before.duration)
    assert str(tmp_path) in node.output
    request = PredictDurations.Request(
        situations=[Situation(robot=pose_of(Pose(-2.0, 0.0, 0.0)))],
        calls=[call("goToPose", Pose(1.0, 0.0, 0.0))],
    )
    table = client.call(PredictDurations, "predict_durations", request)
    assert table.reason == "path times of goToPose, as no drives are known yet"
    assert table.durations[0] > 0.0
    client.eventually(lambda: health and health[-1].level == DiagnosticStatus.OK, "no problem")


@pytest.mark.long
def test_a_hundred_stations_are_answered_and_never_worse_than_as_sent(
    host: Host, client: Client
) -> None:
    """With the deadline that the node has by default."""
    host("refinement", domain="drive")
    places = np.random.default_rng(7).uniform(-3.0, 3.0, (LONGEST_CHAIN, 2)).tolist()
    request = RefineSubgoal.Request()
    request.chain.calls = [
        call("goToPose", Pose(x, y, 0.0), opened=("order", "yaw")) for x, y in places
    ]
    answer = refine(client, request)
    assert answer.accepted, answer.reason
    assert list(answer.original_order) == list(range(LONGEST_CHAIN))
    assert sorted(answer.order) == sorted(answer.best_order) == list(range(LONGEST_CHAIN))
    assert answer.cost_after <= answer.cost_before
    for index, step in zip(answer.order, answer.chain.calls, strict=True):
        place = step.goal.pose.position
        assert [place.x, place.y] == places[index]
    request.chain.calls.append(call("goToPose", Pose(0.0, 0.0, 0.0)))
    refused = refine(client, request)
    assert not refused.accepted
    assert "chain.calls: expected 1 to 100 items, got 101" in refused.reason


def test_markers_of_the_last_search_are_latched(service_client: Client) -> None:
    refine(service_client, request_of_the_paper())
    received = service_client.listen(MarkerArray, "refinement_markers", LATCHED)
    service_client.eventually(lambda: received, "markers")
    markers = received[0].markers
    assert any(len(marker.points) == len(marker.colors) >= 48 for marker in markers)
    assert all(marker.header.frame_id == "odom" for marker in markers)


def test_steps_are_predicted_from_several_situations(service_client: Client) -> None:
    starts = [Situation(robot=pose_of(Pose(x, 0.0, 0.0))) for x in (-2.0, 1.0)]

    def answered(calls: list[TopCall], *, pairs: bool = False) -> PredictDurations.Response:
        request = PredictDurations.Request(situations=starts, calls=calls, pairs=pairs)
        return service_client.call(PredictDurations, "predict_durations", request)

    found = answered([call("goToPose", Pose(x, 0.0, 0.0)) for x in (-1.0, 0.0, 2.0)])
    assert found.accepted, found.reason
    first, second = found.durations[:3], found.durations[3:]
    assert first[0] < first[1] < first[2]
    assert second[2] == min(second)
    assert len(found.spreads) == len(found.success) == 6
    assert all(map(math.isfinite, (*found.spreads, *found.success)))
    stops = [call("goToPose", Pose(x, 0.0, 0.0), opened=("yaw",)) for x in (-1.0, 2.0)]
    table = answered(stops, pairs=True).durations
    assert len(table) == (2 + 2) * 2
    assert (table[4], table[7]) == (0.0, 0.0)
    assert table[5] == pytest.approx(table[6], rel=0.2)  # there and back
    for calls, reason in (
        ([], "calls: expected 1 to 100 items, got 0"),
        ([call("fly", Pose(0.0, 0.0, 0.0))], "calls[0].top"),
    ):
        refused = answered(calls)
        assert not refused.accepted
        assert reason in refused.reason


def test_a_goal_is_planned_and_an_impossible_goal_is_rejected(service_client: Client) -> None:
    def answered(goal: PlanGoal) -> PlanChains.Response:
        request = PlanChains.Request(goal=goal, situation=request_of_the_paper().situation)
        return service_client.call(PlanChains, "plan_chains", request)

    planned = answered(PlanGoal(name="ball_in_goal"))
    assert planned.accepted, planned.reason
    steps = [[step.top for step in chain.calls] for chain in planned.chains]
    assert steps == [["goToBall", "dribbleBall", "shoot"]]
    assert list(planned.chains[0].calls[0].open) == ["speed", "yaw"]
    assert planned.chains[0].calls[0].goal.header.frame_id == "odom"
    assert answered(PlanGoal(terms=[GoalTerm(variable="ball.x", low=-1.0, high=1.0)])).holds
    for goal, reason in (
        (PlanGoal(name="ball_in_basket"), "goal.name: expected one of ['ball_held', "),
        (PlanGoal(), "goal.terms: expected 1 to 8 items, got 0"),
        (PlanGoal(terms=[GoalTerm(variable="ball.x")] * 9), "goal.terms: expected 1 to 8 items"),
        (PlanGoal(terms=[GoalTerm(variable="ball.x", value=math.nan)]), "expected a finite number"),
    ):  # fmt: skip
        answer = answered(goal)
        assert not answer.accepted
        assert reason in answer.reason
