"""The executor with a domain file whose actions are on external servers."""

import time
from typing import Any

import pytest
from chain_client import call
from hall import Hall
from visualization_msgs.msg import MarkerArray

from ator_interfaces.msg import Outcome
from ator_interfaces.srv import RefineSubgoal
from ator_ros.geometry import Pose
from ator_ros.nodes.qos import LATCHED, SERVICES


def test_a_chain_is_executed_by_a_server_while_cmd_vel_is_silent(hall: Hall) -> None:
    server, (first, second) = hall.serve(), (Pose(1.0, 0.5, 0.3), Pose(2.0, 0.0, 1.0))
    sent = hall.chains.send([call("visit", first), call("visit", second)])
    hall.client.eventually(lambda: server.goals, "a goal")
    commands = len(hall.chains.commands)
    sent.wait_for_status("executed by drive")
    time.sleep(0.3)
    assert len(hall.chains.commands) <= commands + 1  # one may have been in transit
    hall.reach(server, 1, first)
    hall.reach(server, 2, second)
    result = sent.result()
    assert result.outcome.code == Outcome.SUCCEEDED, result.outcome.reason
    assert [record.action for record in result.record.actions] == ["navigate", "navigate"]
    for record in result.record.actions:
        assert record.outcome.reason == "drive succeeded"
        assert record.actual.duration > 0.0
        assert record.actual.accuracy == pytest.approx(0.0, abs=1e-6)


def test_stations_are_marked_with_their_numbers_as_sent_in_the_order_of_refinement(
    hall: Hall,
) -> None:
    client = hall.client

    def reverse(request: RefineSubgoal.Request, response: Any) -> Any:
        response.chain.calls = list(request.chain.calls[::-1])
        response.order = [1, 0]
        response.accepted = response.refined = True
        return response

    client.within(
        lambda: client.node.create_service(
            RefineSubgoal, "refine_subgoal", reverse, qos_profile=SERVICES
        )
    )
    markers = client.listen(MarkerArray, "chain_markers", LATCHED)
    server, (first, second) = hall.serve(), (Pose(2.0, 0.0, 0.0), Pose(1.0, 0.0, 0.0))
    chain = [call("visit", pose, opened=("order",)) for pose in (first, second)]
    sent = hall.chains.send(chain, refine=True)
    hall.reach(server, 1, second)
    client.eventually(
        lambda: {"2 (1st)", "1 (2nd)"} <= {each.text for each in markers[-1].markers}, "the numbers"
    )
    hall.reach(server, 2, first)
    assert list(sent.result().record.order) == [1, 0]
    assert sent.feedback[-1].step == 0


@pytest.mark.parametrize("cancels", [True, False])
def test_a_canceled_goal_ends_with_its_server_or_a_timeout(hall: Hall, cancels: bool) -> None:
    server = hall.serve(cancels=cancels)
    sent = hall.chains.send([call("visit", Pose(1.0, 0.5, 0.3))])
    hall.client.eventually(lambda: server.goals, "a goal")
    sent.wait_for_status("executed by drive")
    began = time.monotonic()
    assert sent.cancel()
    hall.client.eventually(lambda: server.canceled, "a cancellation")
    time.sleep(0.2)
    assert not sent.ended()
    if cancels:
        hall.client.within(lambda: server.finish("canceled"))
    assert sent.outcome().code == Outcome.CANCELED
    took = time.monotonic() - began
    assert 0.2 < took < 1.0 if cancels else 1.0 < took < 3.0


def test_a_newer_goal_waits_for_the_active_server(hall: Hall) -> None:
    server = hall.serve()
    old = hall.chains.send([call("visit", Pose(1.0, 0.5, 0.3))])
    old.wait_for_status("executed by drive")
    new = hall.chains.send([call("visit", Pose(2.0, 0.5, 0.3))])
    assert old.outcome().code == Outcome.PREEMPTED
    hall.client.eventually(lambda: server.canceled, "a cancellation")
    assert len(server.goals) == 1
    hall.client.within(lambda: server.finish("canceled"))
    hall.reach(server, 2, Pose(2.0, 0.5, 0.3))
    assert new.outcome().code == Outcome.SUCCEEDED


LIVE = {"latency": 0.0, "start_timeout": 1.0, "odom_timeout": 2.0, "refinement_timeout": 1.0}
LIVE |= {"action_timeout": 1.0, "refine_again_after": 0.0, "cart_timeout": 1.0}


@pytest.mark.parametrize(("x", "code"), [(9.0, Outcome.OUT_OF_BOUNDS), (0.1, Outcome.FAILED)])
def test_the_fence_and_a_changed_time_limit_end_a_goal(hall: Hall, x: float, code: int) -> None:
    assert all(result.successful for result in hall.client.set_parameters("executor", **LIVE))
    server = hall.serve()
    sent = hall.chains.send([call("visit", Pose(1.0, 0.5, 0.3))])
    hall.client.eventually(lambda: server.goals, "a goal")
    hall.base.pose = Pose(x, 0.0, 0.0)
    hall.client.eventually(lambda: server.canceled, "a cancellation")
    hall.client.within(lambda: server.finish("canceled"))
    assert sent.outcome().code == code


def test_an_action_type_that_is_not_installed_does_not_affect_others(hall: Hall) -> None:
    diagnostics = hall.client.statuses()
    outcome = hall.chains.send([call("fly", Pose(1.0, 0.0, 0.0))]).outcome()
    assert outcome.code == Outcome.FAILED
    assert "flying_msgs/action/Fly to be installed" in outcome.reason
    hall.client.eventually(
        lambda: any(
            "; without it fly cannot be executed" in status.message for status in diagnostics
        ),
        "diagnostics",
    )
    server = hall.serve()
    sent = hall.chains.send([call("visit", Pose(1.0, 0.0, 0.0))])
    hall.reach(server, 1, Pose(1.0, 0.0, 0.0))
    assert sent.outcome().code == Outcome.SUCCEEDED


def test_the_end_is_judged_on_a_state_that_is_newer_than_the_result(hall: Hall) -> None:
    server, goal = hall.serve(), Pose(1.0, 0.5, 0.3)
    sent = hall.chains.send([call("visit", goal)])
    hall.client.eventually(lambda: server.goals, "a goal")

    def finish_before_odometry() -> None:
        arrival = hall.base.time + 0.2

        def arrive() -> None:
            if hall.base.time >= arrival:
                hall.base.pose = goal

        hall.client.node.create_timer(0.01, arrive)
        server.finish()

    hall.client.within(finish_before_odometry)
    result = sent.result()
    assert result.outcome.code == Outcome.SUCCEEDED, result.outcome.reason
    assert result.record.actions[0].actual.accuracy == pytest.approx(0.0, abs=1e-6)


def test_a_server_that_succeeds_elsewhere_fails(hall: Hall) -> None:
    server = hall.serve()
    sent = hall.chains.send([call("visit", Pose(1.0, 0.5, 0.3))])
    hall.reach(server, 1, Pose(0.5, 0.5, 0.3))
    outcome = sent.outcome()
    assert outcome.code == Outcome.FAILED
    assert outcome.reason.startswith("post-condition of visit: ")
