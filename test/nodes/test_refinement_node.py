"""The `refinement` node over its ROS interfaces."""

from __future__ import annotations

from pathlib import Path

import pytest
from conftest import Host
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from experience_rows import uncertain
from process import Processes
from refinement_requests import refine, request_of_the_paper, save_small_models
from ros_client import Client
from visualization_msgs.msg import MarkerArray

from ator_ros.nodes.qos import LATCHED, RESULTS

pytestmark = pytest.mark.node


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with small performance models."""
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
    results = service_client.set_parameters("refinement", models="/etc", frame="moon")
    assert [result.successful for result in results] == [False] * 2
    assert all("read-only" in result.reason for result in results)


def test_the_gate_can_be_disabled_at_runtime(host: Host, client: Client, tmp_path: Path) -> None:
    save_small_models(tmp_path, uncertain)
    host("refinement", models=tmp_path, deadline=20.0)
    request = request_of_the_paper(yaw=3.0)
    assert not refine(client, request).refined
    for gate in (False, True):
        assert [result.successful for result in client.set_parameters("refinement", gate=gate)] == [True]
        assert refine(client, request).refined is not gate


def test_the_failure_cost_is_the_parameter_unless_requested(
    host: Host, client: Client, tmp_path: Path
) -> None:
    save_small_models(tmp_path)
    host("refinement", models=tmp_path, deadline=20.0)
    request = request_of_the_paper(yaw=3.0)
    request.objective.success = 100.0
    by_request = refine(client, request).cost_before
    request.objective.success = -1.0
    assert refine(client, request).cost_before < by_request
    assert [each.successful for each in client.set_parameters("refinement", failure_cost=100.0)] == [True]
    assert refine(client, request).cost_before == pytest.approx(by_request)


def test_diagnostics_list_the_models(service_client: Client) -> None:
    health = service_client.listen(DiagnosticArray, "/diagnostics", RESULTS)
    service_client.eventually(lambda: health, "diagnostics")
    values = {value.key: value.value for value in health[-1].status[0].values}
    assert values["models of default"] == "dribbleBall, goToPose, shoot"


def test_without_models_it_warns_and_continues(start, client: Client, tmp_path: Path) -> None:
    health = client.listen(DiagnosticArray, "/diagnostics", RESULTS)
    node = start("refinement", models=tmp_path)
    response = refine(client, request_of_the_paper())
    assert not response.accepted
    assert str(tmp_path) in response.reason
    client.eventually(lambda: health and health[-1].status[0].level == DiagnosticStatus.ERROR, "an error")
    assert node.stop() == 0


def test_markers_of_the_last_search_are_latched(service_client: Client) -> None:
    refine(service_client, request_of_the_paper())
    received = service_client.listen(MarkerArray, "refinement_markers", LATCHED)
    service_client.eventually(lambda: received, "markers")
    markers = received[0].markers
    assert any(len(marker.points) == len(marker.colors) >= 48 for marker in markers)
    assert all(marker.header.frame_id == "odom" for marker in markers)
