"""Answers about invalid chains (in process)."""

import numpy as np
import pytest
from chain_client import call
from maps import hall_map
from refinement_fakes import LIBRARY, ROBOT, USED, FakeModel, models, turning_time

from ator_interfaces.msg import AlternativeChain, ObjectState, TopCall, TopChain
from ator_interfaces.srv import RefineSubgoal
from ator_ros.domains.domain import find_domain
from ator_ros.execution.fence import Fence
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import answer_of, gain_of, pose_of
from ator_ros.nodes.refinement import refine_request
from ator_ros.refinement import RefinementError
from ator_ros.refinement.gate import Gate
from ator_ros.refinement.refiner import Refiner
from ator_ros.world.grid_map import GridMap


def request(*calls: TopCall) -> RefineSubgoal.Request:
    """Return a request for a robot at (-2, 0) with the ball at the origin."""
    sent = RefineSubgoal.Request()
    sent.situation.robot = pose_of(Pose(-2.0, 0.0, 0.0))
    sent.situation.objects = [ObjectState(name="ball")]
    sent.chain.calls = list(calls)
    return sent


def answered(sent: RefineSubgoal.Request, *without: str) -> RefineSubgoal.Response:
    known = {action: model for action, model in models().items() if action not in without}
    found = refine_request(
        sent, Refiner(ROBOT, known, ranges=LIBRARY.ranges), LIBRARY, frame="odom"
    )
    reason = found.refinement.reason
    return answer_of(found, sent, gain_of(), reason=reason, action_set="default", frame="odom")


def test_openings_are_returned_unchanged() -> None:
    answer = answered(request(call("goToBall", Pose(0.0, 0.0, 2.0), opened=("*", "yaw"))))
    assert (
        sorted(answer.chain.calls[0].open) == sorted(answer.original.calls[0].open) == ["*", "yaw"]
    )


def stations(*xs: float) -> list[TopCall]:
    """Return stations on the line through the robot, which leave their order open."""
    return [call("goToPose", Pose(x, 0.0, 0.0), opened=("order", "yaw")) for x in xs]


def places(chain: TopChain) -> list[float]:
    return [each.goal.pose.position.x for each in chain.calls]


@pytest.mark.parametrize("refined", [True, False])
def test_predictions_are_in_the_order_of_their_chains(refined: bool) -> None:
    sent = request(*stations(2.0, -1.0, 1.0))
    known = {"goToPose": FakeModel(turning_time, USED, spread=0.1 if refined else 100.0)}
    refiner = Refiner(ROBOT, known, Gate(), ranges=LIBRARY.ranges)
    found = refine_request(sent, refiner, LIBRARY, frame="odom")
    answer = answer_of(found, sent, gain_of(), reason="", action_set="default", frame="odom")
    assert answer.refined is refined
    assert list(answer.original_order) == [0, 1, 2]
    assert list(answer.best_order) == [1, 2, 0]
    assert list(answer.order) == [1, 2, 0] if refined else [0, 1, 2]
    assert places(answer.original) == [2.0, -1.0, 1.0]
    assert places(answer.chain) == [-1.0, 1.0, 2.0] if refined else [2.0, -1.0, 1.0]
    before, after = (
        [action.duration for action in actions]
        for actions in (answer.before_actions, answer.after_actions)
    )
    assert (sum(before), sum(after)) == pytest.approx(
        (answer.before.duration, answer.after.duration)
    )
    assert np.argmax(after) == 1  # 2 m, the others 1 m
    assert before[0] - after[0] == pytest.approx(3.0, abs=0.01)  # 4 m as listed
    assert {free.subgoal for free in answer.free} == {0, 1, 2}


class TestAlternatives:
    """Several chains for the same goal: a detour, a straight one, and an invalid shot."""

    far = (
        call("goToBall", Pose(0.0, 0.0, 0.0), opened=("yaw",)),
        call("dribbleBall", Pose(2.2, 1.5, 0.0), opened=("yaw",)),
        call("shoot", Pose(4.0, 0.0, 0.0)),
    )
    near = (far[0], call("dribbleBall", Pose(2.0, 0.0, 0.0), opened=("yaw",)), far[2])
    at_once = (far[0], far[2])

    def request_for(self, *chains: tuple[TopCall, ...]) -> RefineSubgoal.Request:
        first, *others = chains
        sent = request(*first)
        sent.alternatives = [AlternativeChain(calls=list(chain)) for chain in others]
        return sent

    def test_the_best_is_chosen_and_all_are_listed_with_predictions(self) -> None:
        answer = answered(self.request_for(self.far, self.at_once, self.near))
        assert answer.chosen == 2
        assert [each.accepted for each in answer.alternatives] == [True, False, True]
        alone = [answered(self.request_for(chain)) for chain in (self.far, self.near)]
        assert answer.chain == alone[1].chain
        assert answer.alternatives[0].cost == min(alone[0].cost_before, alone[0].cost_after)
        assert answer.alternatives[2].cost < answer.alternatives[0].cost
        assert answer.alternatives[2].predicted.duration == pytest.approx(answer.after.duration)
        assert "pre-condition of step 2 (shoot)" in answer.alternatives[1].reason
        assert answer.alternatives[1].chain.calls[1].top == "shoot"

    def test_the_chain_of_the_request_may_be_skipped(self) -> None:
        answer = answered(self.request_for(self.at_once, self.far))
        assert (answer.accepted, answer.chosen) == (True, 1)
        assert [each.accepted for each in answer.alternatives] == [False, True]

    def test_without_any_valid_plan_all_reasons_are_listed(self) -> None:
        unknown = (call("fly", Pose(0.0, 0.0, 0.0)),)
        with pytest.raises(RefinementError) as caught:
            answered(self.request_for(self.at_once, self.at_once, unknown))
        assert "alternative 1: no valid plan: " in str(caught.value)
        assert "alternative 2: alternatives[1].calls[0].top: " in str(caught.value)

    def test_an_alternative_without_the_missing_object_is_chosen(self) -> None:
        sent = self.request_for(self.far, (call("goToPose", Pose(0.0, 0.0, 0.0)),))
        sent.situation.objects = []
        answer = answered(sent)
        assert (answer.accepted, answer.chosen) == (True, 1)
        assert "ball" in answer.alternatives[0].reason

    def test_a_chain_without_a_route_is_skipped_wherever_it_stands(self) -> None:
        free = hall_map().free.copy()
        free[:, 118:122] = False  # no door
        domain = find_domain("pursuit").on_map(GridMap("closed", free, 0.05, Pose(-6.0, -4.0, 0.0)))
        robot = domain.robot()
        refiner = Refiner(robot, {"pursue": FakeModel(turning_time, USED)}, ranges=domain.ranges)
        chains = [(call("visit", Pose(x, 1.0, 0.0)),) for x in (3.0, -1.0, 4.0)]
        for numbers in ((0, 1), (1, 0), (1, 0, 2)):
            sent = self.request_for(*(chains[number] for number in numbers))
            sent.situation.objects = []
            found = refine_request(
                sent, refiner, domain.library(robot), frame="odom", fence=Fence.around(robot)
            )
            assert found.number == numbers.index(1)
            assert "in reach of x -2.00 m" in str(found.judged[numbers.index(0)])

    def test_chains_without_a_model_are_last(self) -> None:
        assert answered(self.request_for(self.near, self.far[:2]), "shoot").chosen == 1

    def test_each_order_is_that_of_the_calls_of_its_own_chain(self) -> None:
        sent = self.request_for(tuple(stations(4.0, 3.0, 2.0)), tuple(stations(0.0, -1.0)))
        answer = answered(sent)
        assert answer.chosen == 1
        assert list(answer.order) == list(answer.best_order) == [1, 0]
        assert places(answer.chain) == [-1.0, 0.0]
        assert [list(each.order) for each in answer.alternatives] == [[2, 1, 0], [1, 0]]
        assert places(answer.alternatives[0].chain) == [2.0, 3.0, 4.0]
        assert answer.alternatives[1].cost == answer.cost_after < answer.alternatives[0].cost

    def test_a_single_chain_has_no_list(self) -> None:
        answer = answered(self.request_for(self.far))
        assert (len(answer.alternatives), answer.chosen) == (0, 0)
