"""The choice among alternatives, and what an answer says."""

import math

import pytest
from refinement_fakes import ANGLE, NOTHING, ROBOT, call, models, two_steps, world

from ator_ros.geometry import Pose
from ator_ros.refinement import RefinementError
from ator_ros.refinement.objective import Objective
from ator_ros.refinement.refiner import MOST_ALTERNATIVES, Refiner, choose, rank, replaced
from ator_ros.tops.chain import TopChain


def drive(*xs: float, opened: frozenset[str] = ANGLE) -> TopChain:
    return TopChain(tuple(call("goToPose", x, 0.0, 0.0, opened) for x in xs))


def test_the_chain_with_the_least_cost_is_chosen() -> None:
    refiner = Refiner(ROBOT, models())
    chains = [drive(3.0), drive(1.0), drive(2.0)]
    found = choose(refiner, world(), chains)
    assert found.number == 1
    assert found.refinement == found.judged[1]
    assert [rank(each) for each in found.judged] == [
        refiner.refine(world(), chain).predicted.cost for chain in chains
    ]
    assert found.complete
    assert 0.0 < found.share_done <= 1.0


def test_skipped_chains_come_last() -> None:
    refiner = Refiner(ROBOT, models())
    found = choose(refiner, world(), ["no ball", drive(3.0, 1.0, 3.0)])
    assert found.number == 1
    assert rank("no ball") == math.inf
    assert found.judged[0] == "no ball"


def test_an_invalid_chain_is_skipped_and_without_any_the_reasons_are_given() -> None:
    refiner = Refiner(ROBOT, models())
    invalid = TopChain((call("dribbleBall", 1.0, 0.0, 0.0),))
    assert choose(refiner, world(), [invalid, drive(1.0)]).number == 1
    with pytest.raises(RefinementError, match=r"^no valid plan: .*; alternative 1: no ball$"):
        choose(refiner, world(), [invalid, "no ball"])
    many = ["x" * 200] * (1 + MOST_ALTERNATIVES)
    with pytest.raises(RefinementError) as error:
        choose(refiner, world(), many)
    assert "alternative 4: " + "x" * 50 in str(error.value) or "more" in str(error.value)


def test_a_search_that_is_done_has_a_share_of_one_at_most() -> None:
    refiner = Refiner(ROBOT, models())
    assert choose(refiner, world(), [drive(1.0, opened=NOTHING)]).share_done == 1.0
    late = choose(refiner, world(), [drive(1.0), drive(2.0)], deadline=lambda: True)
    assert not late.complete
    assert late.share_done == 0.0


def test_an_answer_has_the_gain_in_cost_and_in_time() -> None:
    answer = Refiner(ROBOT, models()).refine(
        world(), two_steps(yaw=2.0), Objective({"duration": 2.0})
    )
    assert answer.gain == answer.before.cost - answer.after.cost > 0.0
    assert answer.saved == pytest.approx(0.5 * answer.gain)
    assert (answer.chain, answer.predicted) == (answer.best, answer.after)
    kept = Refiner(ROBOT, models()).refine(world(), answer.best, Objective({"duration": 2.0}))
    if not kept.refined:
        assert (kept.chain, kept.predicted) == (kept.original, kept.before)


def test_the_uncertainty_is_that_of_the_difference_whatever_is_free() -> None:
    refiner = Refiner(ROBOT, models())
    one = refiner.refine(world(), drive(1.0, 2.0, opened=ANGLE))
    both = refiner.refine(world(), drive(1.0, 2.0, opened=frozenset({"yaw", "speed"})))
    assert len(both.free) == 2 * len(one.free) == 4
    assert both.uncertainty == one.uncertainty == pytest.approx(0.1)


def test_curves_are_those_of_subgoals_with_free_variables() -> None:
    chain = TopChain((*drive(1.0, opened=NOTHING).calls, *drive(2.0).calls))
    answer = Refiner(ROBOT, models()).refine(world(), chain)
    ((subgoal, names, values, totals),) = [
        (each.subgoal, each.names, each.values, each.totals) for each in answer.curves
    ]
    assert (subgoal, names, values.shape[1]) == (1, ("yaw",), 1)
    assert len(values) == len(totals) > 20
    assert totals.min() == pytest.approx(answer.after.cost, abs=0.05)


def test_many_reasons_are_counted() -> None:
    chain = TopChain(
        tuple(call("goToPose", float(x), 0.0, 0.0, frozenset({"tilt"})) for x in range(9))
    )
    answer = Refiner(ROBOT, models()).refine(world(), chain)
    assert answer.reason.startswith(
        "nothing is free: tilt of step 1 (goToPose) is no goal variable"
    )
    six = TopChain(chain.calls[:6])
    assert "more" not in Refiner(ROBOT, models()).refine(world(), six).reason


def test_goal_variables_are_replaced_by_name() -> None:
    chain = replaced(drive(1.0, 2.0), 1, {"yaw": 1.5, "speed": 0.2})
    assert chain.calls[1].goal.pose == Pose(2.0, 0.0, 1.5)
    assert chain.calls[1].goal.speed == 0.2
    assert chain.calls[0] == drive(1.0, 2.0).calls[0]
