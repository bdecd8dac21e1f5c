"""The orders that a chain allows: groups, precedences and conditions."""

import dataclasses
import itertools

import pytest
from refinement_fakes import ANGLE, LIBRARY, NOTHING, ROBOT, call, world

from ator_ros.actions.goal_variables import ORDER, STOP, with_values
from ator_ros.tops.chain import InvalidChainError, TopCall, TopChain
from ator_ros.tops.ordering import in_valid_order, ordering_of, possible_steps

OPEN = ANGLE | {ORDER}
PASSED = {STOP: 0.0}


def stop(x: float, *after: int, opened: frozenset[str] = OPEN) -> TopCall:
    return dataclasses.replace(call("goToPose", x, 0.0, 0.0, opened), after=after)


FIXED = stop(0.5, opened=ANGLE)
"""A stop that keeps its place."""


def allowed(chain: TopChain) -> list[tuple[int, ...]]:
    ordering = ordering_of(chain)
    orders = itertools.permutations(range(len(chain)))
    return [order for order in orders if ordering.fault(order) is None]


def test_calls_that_open_their_order_change_places_between_those_that_do_not() -> None:
    chain = TopChain((FIXED, stop(1.0), stop(2.0), FIXED, stop(3.0), stop(4.0), FIXED))
    assert ordering_of(chain).groups == ((0,), (1, 2), (3,), (4, 5), (6,))
    assert allowed(chain) == [
        (0, *first, 3, *second, 6)
        for first in ((1, 2), (2, 1))
        for second in ((4, 5), (5, 4))
    ]  # fmt: skip
    assert not ordering_of(TopChain((FIXED, stop(1.0), FIXED))).is_open


def test_precedences_hold_also_through_other_calls() -> None:
    chain = TopChain((stop(0.0, 1), stop(1.0, 2), stop(2.0), stop(3.0)))
    expected = [
        order
        for order in itertools.permutations(range(4))
        if order.index(2) < order.index(1) < order.index(0)
    ]
    assert allowed(chain) == expected


@pytest.mark.parametrize(
    ("calls", "reason"),
    [
        ((stop(0.0, 2), stop(1.0)), r"step 1 \(goToPose\): after: .* other calls, 0 to 1, got 2"),
        ((stop(0.0, 0), stop(1.0)), "expected indices of other calls"),
        ((stop(0.0, -1), stop(1.0)), "expected indices of other calls"),
        ((stop(0.0, 1), stop(1.0, 2), stop(2.0, 0)), "no circle, got one of steps 1, 2, 3"),
        ((stop(0.0, 2), FIXED, stop(1.0)), r"cannot come after step 3 .* keeps a later place"),
        ((stop(0.0, 1), FIXED), r"cannot come after step 2 .* keeps a later place"),
    ],
)
def test_what_cannot_hold_is_refused_with_the_reason(
    calls: tuple[TopCall, ...], reason: str
) -> None:
    with pytest.raises(InvalidChainError, match=reason):
        ordering_of(TopChain(calls))


def test_a_precedence_that_holds_anyway_does_not_restrict() -> None:
    assert len(allowed(TopChain((stop(0.0), FIXED, stop(1.0, 0, 1), stop(2.0))))) == 2


def test_indices_follow_the_calls_into_another_order() -> None:
    chain = TopChain((stop(0.0, 2), stop(1.0), stop(2.0)))
    moved = chain.reordered((2, 0, 1))
    assert [each.goal.pose.x for each in moved.calls] == [2.0, 0.0, 1.0]
    assert moved.order == (2, 0, 1)
    assert moved.calls[1].after == (0,)
    assert not moved.violations(world(), ROBOT)
    assert moved.reordered((1, 2, 0)) == chain
    assert "step 1 (goToPose) must come after step 3" in chain.violations(world(), ROBOT)[0]


def test_the_first_order_that_is_a_valid_plan_is_taken() -> None:
    fetch = call("goToBall", 0.0, 0.0, 0.0, OPEN)
    carry = call("dribbleBall", 1.0, 1.0, 0.0, OPEN)
    pose = stop(2.0, 0)
    chain = TopChain((carry, pose, fetch))
    valid = in_valid_order(chain, world(), ROBOT)
    assert valid.order == (2, 0, 1)
    assert in_valid_order(valid, world(), ROBOT) == valid
    closed = TopChain(tuple(dataclasses.replace(each, open=ANGLE) for each in (carry, fetch)))
    with pytest.raises(InvalidChainError, match="pre-condition of step 1"):
        in_valid_order(closed, world(), ROBOT)


def test_without_a_valid_order_the_condition_is_named() -> None:
    far = world(ball=(3.0, 2.0))
    chain = TopChain(
        (call("dribbleBall", 1.0, 1.0, 0.0, OPEN), call("goToBall", 0.0, 0.0, 0.0, OPEN))
    )
    with pytest.raises(InvalidChainError, match=r"in no order: .*step 2 \(goToBall\).*ball\.x"):
        in_valid_order(chain, far, ROBOT)


def test_possible_steps_are_those_of_the_valid_orders() -> None:
    fetch = call("goToBall", 0.0, 0.0, 0.0, OPEN)
    carry = call("dribbleBall", 1.0, 1.0, 0.0, OPEN)
    chain = TopChain((fetch, carry, stop(2.0), stop(3.0, 1, opened=NOTHING | {ORDER})))
    ordering = ordering_of(chain)
    found = possible_steps(chain, ordering, world(), ROBOT, lambda: False)
    assert found is not None
    (possible,) = found

    def can(order: tuple[int, ...]) -> bool:
        done = 0
        last = 0
        for index in order:
            if not possible[done, last, index]:
                return False
            done |= 1 << index
            last = index + 1
        return True

    for order in itertools.permutations(range(4)):
        moved = chain.reordered(order)
        assert can(order) == (not moved.violations(world(), ROBOT))
    assert LIBRARY["goToBall"].pre.terms


def test_possible_steps_are_given_up_at_the_first_check_after_the_deadline() -> None:
    chain = TopChain(tuple(stop(float(x)) for x in range(10)))
    left = 20
    checks = 0

    def passed() -> bool:
        nonlocal checks
        checks += 1
        return checks > left

    assert possible_steps(chain, ordering_of(chain), world(), ROBOT, passed) is None
    assert checks == left + 1


def test_the_last_call_of_a_valid_order_stops() -> None:
    passed = [
        dataclasses.replace(each, goal=with_values(each.goal, PASSED))
        for each in (stop(1.0), stop(2.0))
    ]
    last = stop(3.0)
    valid = in_valid_order(TopChain((passed[0], last, passed[1])), world(), ROBOT)
    assert valid.order[-1] == 1
    with pytest.raises(InvalidChainError, match="passing: the last step of a chain must stop"):
        in_valid_order(TopChain(tuple(passed)), world(), ROBOT)
