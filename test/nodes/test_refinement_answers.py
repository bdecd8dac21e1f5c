"""Answers about invalid chains (in process)."""

import pytest
from chain_client import call
from maps import hall_map
from refinement_fakes import LIBRARY, ROBOT, USED, FakeModel, models, turning_time

from ator_interfaces.msg import AlternativeChain, ObjectState, TopCall
from ator_interfaces.srv import RefineSubgoal
from ator_ros.domains.domain import find_domain
from ator_ros.execution.fence import Fence
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import answer_of, gain_of, pose_of
from ator_ros.nodes.refinement import refine_request
from ator_ros.refinement import RefinementError
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

    def test_a_single_chain_has_no_list(self) -> None:
        answer = answered(self.request_for(self.far))
        assert (len(answer.alternatives), answer.chosen) == (0, 0)
