"""Headings within a range or a set: never outside, and the best of those that are allowed."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from refinement_fakes import ANGLE, BOTH, LIBRARY, ROBOT, call, models, two_steps, world

from ator_ros.actions.base import Goal
from ator_ros.actions.goal_variables import ORDER
from ator_ros.geometry import Pose, wrap_angle
from ator_ros.refinement.free_variables import allowed_changes
from ator_ros.refinement.naive import naive_on_paths
from ator_ros.refinement.refiner import Refinement, Refiner
from ator_ros.tops.chain import AllowedRange, InvalidChainError, TopCall, TopChain
from ator_ros.tops.conditions import Condition, Region
from ator_ros.tops.ranges import USUAL_RANGES

REFINER = Refiner(ROBOT, models())
SIDES = ((0.0, 0.0), (math.pi, math.pi))

angles = st.floats(-math.pi, math.pi, allow_subnormal=False)
places = st.floats(-4.0, 4.0, allow_subnormal=False)
arcs = st.lists(
    st.builds(lambda low, width: (low, low + width), angles, st.floats(0.0, 1.0)),
    min_size=1,
    max_size=3,
)


def headings(step: TopCall, *ranges: tuple[float, float]) -> TopCall:
    allowed = tuple(AllowedRange("yaw", low, high) for low, high in ranges)
    return dataclasses.replace(step, allowed=allowed).within_allowed(ROBOT, USUAL_RANGES)


def fixed(chain: TopChain, yaws: tuple[float, ...]) -> TopChain:
    calls = [
        dataclasses.replace(
            each,
            open=frozenset(),
            allowed=(),
            after=(),
            goal=dataclasses.replace(each.goal, pose=each.goal.pose._replace(yaw=yaw)),
        )
        for each, yaw in zip(chain.calls, yaws, strict=True)
    ]
    return TopChain(tuple(calls))


def refined(chain: TopChain) -> Refinement:
    return REFINER.refine(world(), chain, placeholders=True)


def cost(chain: TopChain, yaws: tuple[float, ...]) -> float:
    return refined(fixed(chain, yaws)).before.cost


def is_allowed(chain: TopChain) -> bool:
    return all(
        domain is not None and domain.contains(each.goal.pose.yaw)
        for each in chain.calls
        for domain in [each.range_of("yaw", ROBOT, USUAL_RANGES)]
    )


def test_by_hand_the_nearer_end_of_the_range_is_chosen() -> None:
    """A stop on a straight line, where the best heading is 0, and half a turn costs more."""
    stop = call("goToPose", 0.0, 0.0, 0.0, ANGLE)
    chain = TopChain((headings(stop, (0.3, 2.0)), call("goToPose", 2.0, 0.0, 0.0)))
    found = refined(chain)
    assert found.best.calls[0].goal.pose.yaw == pytest.approx(0.3)
    assert found.original.calls[0].goal.pose.yaw == pytest.approx(0.3)
    [free] = found.free
    assert free.domain.span == (0.3, 2.0)
    assert free.limits == ("allowed 0.3 to 2",)


def test_of_two_sides_the_one_on_the_way_is_chosen() -> None:
    chain = TopChain(
        (
            headings(call("goToPose", 0.0, 0.0, 0.0, ANGLE), *SIDES),
            headings(call("goToPose", -4.0, 0.0, 0.0, ANGLE), *SIDES),
            call("goToPose", -4.0, -3.0, -math.pi / 2.0),
        )
    )
    found = refined(chain).best
    assert abs(found.calls[1].goal.pose.yaw) == pytest.approx(math.pi)
    assert all(abs(math.sin(each.goal.pose.yaw)) < 1e-9 for each in found.calls[:2])


@settings(max_examples=8, deadline=None)
@given(st.lists(st.tuples(places, places, arcs), min_size=2, max_size=3))
def test_no_allowed_heading_is_better_and_none_is_outside(
    stops: list[tuple[float, float, list[tuple[float, float]]]],
) -> None:
    chain = TopChain(
        tuple(headings(call("goToPose", x, y, 0.0, ANGLE), *ranges) for x, y, ranges in stops)
    )
    found = refined(chain)
    assert is_allowed(found.original)
    assert is_allowed(found.best)
    options = []
    for _, _, ranges in stops:
        domain = USUAL_RANGES["yaw"](ROBOT, chain.calls[0].goal).within(ranges)
        assert domain is not None
        options.append(domain.grid(9)[0].tolist())
    least = min(cost(chain, yaws) for yaws in itertools.product(*options))
    assert found.after.cost <= least + 2e-3
    naive = found.original
    for index, choices in enumerate(options):  # each step is the fastest one for itself
        part = TopChain(naive.calls[: index + 1])
        yaws = tuple(each.goal.pose.yaw for each in part.calls)
        alone = [refined(fixed(part, (*yaws[:-1], yaw))).before.actions[-1] for yaw in choices]
        own = refined(fixed(part, yaws)).before.actions[-1]
        assert own["duration"] <= min(each["duration"] for each in alone) + 2e-3


@pytest.mark.parametrize("seed", range(2))
def test_order_and_sides_are_chosen_together(seed: int) -> None:
    rng = np.random.default_rng(seed)
    calls = [
        headings(call("goToPose", *map(float, rng.uniform(-4, 4, 2)), 0.0, ANGLE | {ORDER}), *SIDES)
        for _ in range(4)
    ]
    chain = TopChain(tuple(calls))
    found = refined(chain)
    assert is_allowed(found.best)
    least = min(
        cost(chain.reordered(order), yaws)
        for order in itertools.permutations(range(4))
        for yaws in itertools.product((0.0, math.pi), repeat=4)
    )
    assert found.after.cost == pytest.approx(least, abs=1e-6)


def test_speeds_within_a_range() -> None:
    stop = call("goToPose", 0.0, 0.0, 0.0, BOTH)
    limited = dataclasses.replace(stop, allowed=(AllowedRange("speed", 0.1, 0.2),))
    chain = TopChain((limited, call("goToPose", 2.0, 0.0, 0.0)))
    found = refined(chain)
    assert found.original.calls[0].goal.speed == pytest.approx(0.1)
    assert found.best.calls[0].goal.speed == pytest.approx(0.2)


def test_a_value_outside_is_replaced_by_the_nearest_allowed_one() -> None:
    sent = headings(call("goToPose", 0.0, 1.0, 2.5, ANGLE), (-0.2, 0.2), (1.5, 1.7))
    assert sent.goal.pose.yaw == pytest.approx(1.7)
    inside = headings(call("goToPose", 0.0, 1.0, 1.6, ANGLE), (1.5, 1.7))
    assert inside.goal.pose.yaw == 1.6
    chain = naive_on_paths(world(), TopChain((sent,)), ROBOT, LIBRARY.ranges)
    assert chain.calls[0].goal.pose.yaw == pytest.approx(0.2)  # it comes at 45 degrees


def test_an_answer_outside_the_range_is_refused() -> None:
    plan = two_steps()
    first = headings(plan.calls[0], (-0.2, 0.2))
    plan = TopChain((first, plan.calls[1]))
    goal = first.goal
    for yaw, good in ((0.15, True), (-0.2, True), (0.3, False), (wrap_angle(math.pi), False)):
        turned = dataclasses.replace(goal, pose=goal.pose._replace(yaw=yaw))
        answer = plan.with_goal(0, turned)
        if good:
            assert allowed_changes(plan, answer, ROBOT, USUAL_RANGES)
        else:
            with pytest.raises(InvalidChainError, match=r"expected a number in -0\.2 to 0\.2"):
                allowed_changes(plan, answer, ROBOT, USUAL_RANGES)


def test_a_region_of_a_condition_is_a_part_of_the_range_too() -> None:
    """The second step may start in headings of 2 to 2.2 rad only, of which the call allows less."""
    watch = dataclasses.replace(
        LIBRARY["goToPose"], name="watch", pre=Condition((Region("robot.yaw", 2.1, -0.1, 0.1),))
    )
    stop = call("goToPose", 0.0, 0.0, 2.1, ANGLE)
    end = TopCall(watch, Goal(Pose(3.0, 0.0, 0.0)))
    found = refined(TopChain((stop, end)))
    [free] = found.free
    assert free.domain.span == pytest.approx((2.0, 2.2))
    assert free.limits == ("pre-condition of step 2 (watch): robot.yaw -0.1 to 0.1 of 2.1",)
    assert found.best.calls[0].goal.pose.yaw == pytest.approx(2.0)
    assert not found.best.violations(world(), ROBOT)
    both = refined(TopChain((headings(stop, (2.15, 3.0)), end)))
    assert both.best.calls[0].goal.pose.yaw == pytest.approx(2.15)
    neither = refined(TopChain((headings(stop, (-1.0, 1.0)), end)))
    assert not neither.free
    assert "without an allowed value: pre-condition of step 2" in neither.not_free[0].reason
