"""What the service answers about steps that no model predicts and chains that are no plan (in process)."""

from __future__ import annotations

import math

import pytest
from chain_client import call
from refinement_fakes import LIBRARY, ROBOT, models

from ator_interfaces.msg import ObjectState, TopCall
from ator_interfaces.srv import RefineSubgoal
from ator_ros.geometry import Pose
from ator_ros.nodes.conversions import pose_of
from ator_ros.nodes.refinement import refining_of
from ator_ros.nodes.refinement_answers import answer_of
from ator_ros.refinement.errors import RefinementError
from ator_ros.refinement.refiner import Refiner
from ator_ros.refinement.slices import completed


def request(*calls: TopCall) -> RefineSubgoal.Request:
    """Ask from (-2, 0), with the ball at the origin."""
    asked = RefineSubgoal.Request()
    asked.situation.robot = pose_of(Pose(-2.0, 0.0, 0.0))
    asked.situation.objects = [ObjectState(name="ball")]
    asked.chain.calls = list(calls)
    return asked


def answered(asked: RefineSubgoal.Request, *without: str) -> RefineSubgoal.Response:
    known = {action: model for action, model in models().items() if action not in without}
    found = completed(refining_of(asked, Refiner(ROBOT, known, ranges=LIBRARY.ranges), LIBRARY, frame="odom"))
    return answer_of(found, action_set="default", frame="odom", want_curve=False)


def test_a_step_without_a_model_is_named_and_the_others_are_refined() -> None:
    asked = request(
        call("goToBall", Pose(0.0, 0.0, 2.0), opened=("yaw",)),
        call("dribbleBall", Pose(0.0, 2.0, 2.0), opened=("yaw",)),
        call("shoot", Pose(4.0, 0.0, 0.0)),
    )
    asked.as_given = True
    answer = answered(asked, "shoot")
    assert answer.refined
    assert list(answer.without_model) == [2]
    assert "no performance model for step 3 (shoot)" in answer.reason
    assert [(each.subgoal, each.name) for each in answer.free] == [(0, "yaw")]
    assert [(each.subgoal, each.name) for each in answer.not_free] == [(1, "yaw")]
    assert [math.isnan(action.duration) for action in answer.before_actions] == [False, False, True]
    for chain, cost, actions in (
        (answer.before, answer.cost_before, answer.before_actions),
        (answer.after, answer.cost_after, answer.after_actions),
    ):
        assert all(map(math.isnan, (chain.duration, chain.spread, chain.success)))
        assert cost == pytest.approx(actions[0].duration + actions[1].duration)
    assert answer.cost_after < answer.cost_before


def test_openings_come_back_as_they_were_sent() -> None:
    answer = answered(request(call("goToBall", Pose(0.0, 0.0, 2.0), opened=("*", "yaw"))))
    assert sorted(answer.chain.calls[0].open) == sorted(answer.original.calls[0].open) == ["*", "yaw"]


@pytest.mark.parametrize(
    ("calls", "reason"),
    [
        ([call("goToBall", Pose(1.0, 0.0, 0.0))], "no valid plan: pre-condition of step 1 (goToBall) now: "),
        (
            [call("goToPose", Pose(1.0, 0.0, 0.0)), call("shoot", Pose(4.0, 0.0, 0.0))],
            "no valid plan: pre-condition of step 2 (shoot) after step 1 (goToPose): ",
        ),
    ],
)
def test_what_is_no_plan_from_the_situation_is_refused(calls: list[TopCall], reason: str) -> None:
    with pytest.raises(RefinementError) as caught:
        answered(request(*calls))
    assert str(caught.value).startswith(reason)
