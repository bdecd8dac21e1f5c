"""Free variables, objective, refiner: what is free is computed, and the rewritten chain is the best."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
import pytest
from refinement_fakes import (
    ANGLE,
    BOTH,
    NOTHING,
    ROBOT,
    SHOOT_USED,
    USED,
    FakeModel,
    call,
    models,
    three_steps,
    turning_time,
    two_steps,
    world,
)

from ator_ros.actions.base import Goal, Point
from ator_ros.geometry import Pose, wrap_angle
from ator_ros.refinement.errors import RefinementError
from ator_ros.refinement.free_variables import DOMAINS, Domain, analyse
from ator_ros.refinement.gate import ThresholdGate
from ator_ros.refinement.objective import MEASURES, Measure, Objective
from ator_ros.refinement.refiner import LONGEST_CHAIN, Refiner
from ator_ros.tops.chain import EVERYTHING, TopChain
from ator_ros.world import RobotState, World


def free_names(chain: TopChain, used: frozenset[str] = USED) -> list[tuple[int, str]]:
    return [(v.subgoal, v.name) for v in analyse(chain, models(used), ROBOT).free]


def test_only_the_angle_is_free_in_the_papers_chain() -> None:
    assert free_names(two_steps()) == [(0, "yaw")]


def test_arrival_speed_is_free_where_the_plan_leaves_it_open() -> None:
    assert free_names(two_steps(BOTH)) == [(0, "yaw"), (0, "speed")]


def test_variables_that_no_model_uses_are_not_free() -> None:
    assert free_names(two_steps(BOTH), USED - {"v", "speedg"}) == [(0, "yaw")]


def test_a_heading_that_only_moves_the_held_ball_counts() -> None:
    # The model uses no heading, but with another heading a robot that holds a ball stands elsewhere.
    assert free_names(two_steps(), frozenset({"x", "y", "xg", "yg"})) == [(0, "yaw")]


def test_free_variables_of_every_subgoal_of_a_longer_chain() -> None:
    assert free_names(three_steps()) == [(0, "yaw"), (1, "yaw")]


def test_last_subgoal_is_refined_where_the_plan_leaves_it_open() -> None:
    chain = TopChain((call("goToBall", 0.0, 0.0, 0.5, ANGLE),))
    result = Refiner(ROBOT, models()).refine(world(), chain)
    assert result.refined
    assert result.chain.calls[0].goal.pose.yaw == pytest.approx(0.0, abs=math.radians(5))


@pytest.mark.parametrize("placeholders", [False, True])
def test_nothing_open_leaves_the_chain_and_predicts_it(placeholders: bool) -> None:
    chain = two_steps(NOTHING)
    result = Refiner(ROBOT, models()).refine(world(), chain, placeholders=placeholders)
    assert result.chain is result.original is result.best is chain
    assert not result.refined
    assert result.reason == "nothing is open: the plan commits to every goal variable"
    compared = Refiner(ROBOT, models()).refine(world(), two_steps())
    assert result.before == result.after == compared.before
    assert [action["duration"] > 0.0 for action in result.before.actions] == [True, True]


def test_nothing_free_names_what_binds_it() -> None:
    result = Refiner(ROBOT, models()).refine(world(), two_steps(frozenset({"x"})))
    assert not result.refined
    assert result.reason == (
        "nothing is free: x of subgoal 1 (goToBall) is bound by the pre-condition of step 1 (goToBall): "
        "ball.x near goal.x"
    )
    assert math.isfinite(result.before.duration)


def test_an_opening_that_a_condition_overrides_is_told_beside_the_gain() -> None:
    named = Refiner(ROBOT, models()).refine(world(), two_steps(frozenset({"x", "yaw"}), yaw=2.0))
    assert named.refined
    assert "; not free: x of subgoal 1 (goToBall) is bound by the pre-condition" in named.reason
    assert [(each.subgoal, each.name) for each in named.not_free] == [(0, "x")]
    everything = Refiner(ROBOT, models()).refine(world(), two_steps(frozenset({EVERYTHING}), yaw=2.0))
    assert [(each.subgoal, each.name) for each in everything.not_free] == [(0, "x"), (0, "y")]
    assert [(each.subgoal, each.name) for each in everything.free] == [(0, "yaw"), (0, "speed")]
    assert "not free" not in everything.reason


def test_what_a_condition_binds_is_not_said_to_be_opened_by_its_name() -> None:
    first = call("goToPose", -0.3, 0.0, 0.0, frozenset({EVERYTHING}))
    chain = TopChain((first, call("dribbleBall", 1.0, 1.0, 0.0)))
    reasons = {each.name: each.reason for each in analyse(chain, models(), ROBOT).not_free}
    assert reasons.keys() == {"x", "y", "yaw"}
    assert all("bound by the pre-condition of step 2 (dribbleBall)" in reason for reason in reasons.values())


def test_a_name_that_no_goal_has_is_told() -> None:
    (told,) = analyse(two_steps(frozenset({"heading"})), models(), ROBOT).not_free
    assert (told.subgoal, told.name) == (0, "heading")
    assert told.reason == "no goal variable, expected one of x, y, yaw, speed"


@pytest.mark.parametrize("top", ["goToBall", "dribbleBall", "goToPose"])
def test_a_last_goal_is_changed_where_it_is_open_and_nowhere_else(top: str) -> None:
    before = (call("goToBall", 0.0, 0.0, 0.0),) if top == "dribbleBall" else ()
    place = (0.0, 0.0) if top == "goToBall" else (1.0, 1.0)
    for opened in (NOTHING, ANGLE, frozenset({"speed"}), BOTH):
        chain = TopChain((*before, call(top, *place, 2.5, opened)))
        last = Refiner(ROBOT, models()).refine(world(), chain, placeholders=True).chain.calls[-1].goal
        assert last.pose[:2] == place
        assert (last.pose.yaw == 2.5) == ("yaw" not in opened)
        assert (last.speed == 0.0) == ("speed" not in opened)


class TestWithoutAModel:
    """A step without a model does not keep the others from being refined."""

    def chain(self) -> TopChain:
        """Return four steps, of which the third has no model; all intermediate headings are open."""
        top = dataclasses.replace(call("dribbleBall", 0.0, 0.0, 0.0).top, name="pushBall", action="push")
        first, last = two_steps(yaw=2.0).calls
        between = dataclasses.replace(last, open=ANGLE)
        pushed = dataclasses.replace(call("dribbleBall", 1.0, 1.0, 0.3, ANGLE), top=top)
        return TopChain((first, between, pushed, call("dribbleBall", 2.0, 0.0, 0.0, ANGLE)))

    def test_the_others_are_refined(self) -> None:
        chain = self.chain()
        result = Refiner(ROBOT, models()).refine(world(), chain)
        assert result.refined
        assert [(each.subgoal, each.name) for each in result.free] == [(0, "yaw"), (3, "yaw")]
        assert result.chain.calls[1:3] == chain.calls[1:3]
        assert result.without_model == (2,)
        assert "no performance model for step 3 (push): neither predicted nor counted" in result.reason

    def test_what_may_change_its_time_is_not_free(self) -> None:
        reasons = {each.subgoal: each.reason for each in analyse(self.chain(), models(), ROBOT).not_free}
        told = "of unknown effect: step 3 (push), which it may change, has no model"
        assert reasons == {1: told, 2: told}

    def test_its_prediction_is_missing_and_costs_nothing(self) -> None:
        result = Refiner(ROBOT, models()).refine(world(), self.chain())
        assert [bool(action) for action in result.before.actions] == [True, True, False, True]
        counted = [action["duration"] for action in result.before.actions if action]
        assert result.before.cost == pytest.approx(sum(counted))
        assert math.isnan(result.before.duration)

    def test_no_model_at_all_changes_nothing(self) -> None:
        result = Refiner(ROBOT, {}).refine(world(), two_steps())
        assert not result.refined
        assert result.without_model == (0, 1)
        assert result.reason.startswith("nothing is free: yaw of subgoal 1 (goToBall) is of unknown effect: ")
        assert result.before.cost == 0.0


@pytest.mark.parametrize("chain", [two_steps(), two_steps(BOTH), three_steps(), three_steps(BOTH)])
def test_refined_chain_costs_what_was_predicted_and_less(chain: TopChain) -> None:
    refiner = Refiner(ROBOT, models())
    result = refiner.refine(world(), chain)
    assert result.refined
    assert result.after.cost < result.before.cost
    again = refiner.refine(world(), result.chain)
    assert again.before.cost == pytest.approx(result.after.cost, abs=1e-9)


def test_committed_variables_stay_as_they_are() -> None:
    chain = three_steps()
    refined = Refiner(ROBOT, models()).refine(world(), chain).chain
    for old, new in zip(chain.calls, refined.calls, strict=True):
        assert new == dataclasses.replace(old, goal=new.goal)
        assert new.goal.pose[:2] == old.goal.pose[:2]
        assert new.goal.speed == old.goal.speed
    assert refined.calls[-1] == chain.calls[-1]


def test_naive_is_fastest_for_the_first_action_alone() -> None:
    chain = Refiner(ROBOT, models()).naive(world(), two_steps(BOTH))
    assert wrap_angle(chain.calls[0].goal.pose.yaw) == pytest.approx(0.0, abs=math.radians(5))
    assert chain.calls[0].goal.speed == 0.0


def test_open_variables_are_compared_with_the_naive_chain() -> None:
    refiner = Refiner(ROBOT, models())
    results = [refiner.refine(world(), two_steps(yaw=yaw), placeholders=True) for yaw in (0.0, 2.0)]
    expected = refiner.refine(world(), refiner.naive(world(), two_steps()))
    for result in results:
        assert result.original == expected.original
        assert (result.chain, result.before) == (expected.chain, expected.before)
        assert result.reason == expected.reason


def test_a_heading_that_its_own_action_does_not_feel_has_no_naive_value() -> None:
    blind = models() | {"goToPose": FakeModel(lambda d: np.hypot(d["xg"] - d["x"], d["yg"]), USED - {"yawg"})}
    refiner = Refiner(ROBOT, blind)
    assert refiner.naive(world(), two_steps(yaw=1.2)) == two_steps(yaw=1.2)
    assert refiner.refine(world(), two_steps(yaw=1.2), placeholders=True).refined


def test_same_request_gives_the_same_bits() -> None:
    refiner = Refiner(ROBOT, models())
    assert refiner.refine(world(), three_steps()).chain == refiner.refine(world(), three_steps()).chain


def test_gate_leaves_the_chain_alone_and_says_why() -> None:
    chain = two_steps()
    result = Refiner(ROBOT, models(), ThresholdGate(100.0)).refine(world(), chain)
    assert result.chain is chain
    assert not result.refined
    assert "is not above the gate's 100.00 s" in result.reason


def test_weight_on_success_lowers_the_arrival_speed() -> None:
    refiner = Refiner(ROBOT, models())
    fast = refiner.refine(world(), two_steps(BOTH), Objective({"duration": 1.0}))
    safe = refiner.refine(world(), two_steps(BOTH), Objective({"duration": 1.0, "success": 20.0}))
    assert fast.chain.calls[0].goal.speed > 0.3
    assert safe.chain.calls[0].goal.speed == 0.0


@pytest.mark.parametrize(
    "weights",
    [{"speed": 1.0}, {"duration": -1.0}, {"duration": math.nan}, {"duration": 0.0}, {"success": math.inf}],
)
def test_bad_weights_are_refused(weights: dict[str, float]) -> None:
    with pytest.raises(RefinementError, match="objective: expected"):
        Objective(weights)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_numbers_that_are_not_finite_are_refused(value: float) -> None:
    refiner = Refiner(ROBOT, models())
    with pytest.raises(RefinementError, match="x of subgoal 2"):
        refiner.refine(world(), two_steps().with_goal(1, Goal(Pose(value, 0.0, 0.0), 0.0, Point.HOLD)))
    with pytest.raises(RefinementError, match="robot: expected a finite state"):
        refiner.refine(World(0.0, RobotState(Pose(0.0, value, 0.0))), two_steps())


def test_absurd_lengths_are_refused() -> None:
    with pytest.raises(
        RefinementError, match=f"expected 1 to {LONGEST_CHAIN} actions, got {LONGEST_CHAIN + 2}"
    ):
        Refiner(ROBOT, models()).refine(world(), TopChain(two_steps().calls * (LONGEST_CHAIN // 2 + 1)))


def test_a_heading_for_which_no_number_is_predicted_is_left_for_another() -> None:
    partly = {
        "goToPose": FakeModel(
            lambda d: np.where(np.asarray(d["yawg"]) == 0.5, math.nan, turning_time(d)), USED
        )
    }
    result = Refiner(ROBOT, models() | partly).refine(world(), two_steps(yaw=0.5))
    assert result.refined
    assert math.isinf(result.before.cost)
    assert math.isfinite(result.after.cost)


def test_predictions_that_are_not_numbers_are_refused() -> None:
    broken = {"goToPose": FakeModel(lambda direct: math.nan * direct["yawg"], USED)}
    with pytest.raises(RefinementError, match="finite prediction"):
        Refiner(ROBOT, models() | broken).refine(world(), two_steps())


class TestFromOutside:
    """What the design promises: a new action, measure or variable needs no edit in refinement."""

    def test_new_action(self) -> None:
        top = dataclasses.replace(call("dribbleBall", 0.0, 0.0, 0.0).top, name="pushBall", action="push")
        pushing = models() | {"push": FakeModel(lambda d: turning_time(d) * 2.0, USED)}
        first, last = two_steps().calls
        chain = TopChain((first, dataclasses.replace(last, top=top)))
        assert Refiner(ROBOT, pushing).refine(world(), chain).refined

    def test_new_measure(self) -> None:
        measures = {**MEASURES, "risk": Measure(("spread",), lambda prediction: prediction.spread**2, "s^2")}
        model = models() | {"goToPose": FakeModel(turning_time, USED, spread=2.0)}
        plain = Refiner(ROBOT, model).refine(world(), two_steps())
        wary = Refiner(ROBOT, model).refine(
            world(), two_steps(), Objective({"duration": 1.0, "risk": 1.0}, measures)
        )
        assert wary.after.cost == pytest.approx(plain.after.cost + 4.0 + 0.01)

    def test_new_free_variable(self) -> None:
        @dataclass(frozen=True, slots=True)
        class SpinGoal(Goal):
            spin: float = 0.0

        def spinning(direct: dict[str, float]) -> object:
            return turning_time(direct) + (direct["sping"] - 0.3) ** 2

        domains = {**DOMAINS, "spin": lambda *_: Domain(-1.0, 1.0, 9)}
        learned = models() | {"goToPose": FakeModel(spinning, USED | {"sping"})}  # type: ignore[arg-type]
        chain = two_steps(ANGLE | {"spin"}).with_goal(0, SpinGoal(Pose(0.0, 0.0, 0.0), 0.0, Point.HOLD))
        result = Refiner(ROBOT, learned, domains=domains).refine(world(), chain)
        assert [variable.name for variable in result.free] == ["yaw", "spin"]
        goal = result.chain.calls[0].goal
        assert isinstance(goal, SpinGoal)
        assert goal.spin == pytest.approx(0.3, abs=0.05)


def test_shooting_heading_is_bound_by_nothing_and_used_by_the_shot() -> None:
    only_shot = {
        "goToPose": FakeModel(turning_time, frozenset()),
        "dribbleBall": FakeModel(turning_time, frozenset()),
    }
    shot = {"shoot": FakeModel(turning_time, SHOOT_USED)}
    free = analyse(three_steps(), only_shot | shot, ROBOT).free
    assert [(variable.subgoal, variable.name) for variable in free] == [(1, "yaw")]


def test_wide_candidates_do_not_mix_up_rows() -> None:
    # The curve of the refiner must be the sum of single predictions.
    refiner = Refiner(ROBOT, models())
    result = refiner.refine(world(), two_steps())
    (curve,) = result.curves
    for yaw, total in zip(curve.values[::12, 0], curve.totals[::12], strict=True):
        goal = dataclasses.replace(two_steps().calls[0].goal, pose=Pose(0.0, 0.0, float(yaw)))
        before = refiner.refine(world(), two_steps().with_goal(0, goal)).before
        assert np.isclose(total, before.cost, atol=1e-9)
