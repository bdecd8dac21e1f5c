"""The division of a round among robots: against all divisions of few steps, and by axioms."""

import itertools
import math

import numpy as np
import pytest

from ator_ros.geometry import FloatArray
from ator_ros.team.division import MOST_EXACT, DivisionError, Steps, divide
from ator_ros.tops.ordering import Ordering, ordering_of_calls


def tables_of(
    places: FloatArray, starts: FloatArray, speeds: tuple[float, ...]
) -> list[FloatArray]:
    """Return the times of robots that drive straight, from starts to places and between them."""
    tables = []
    for start, speed in zip(starts, speeds, strict=True):
        origins = np.vstack((start, places))
        tables.append(np.linalg.norm(origins[:, None] - places[None], axis=2) / speed)
    return tables


def random_tables(robots: int, steps: int, seed: int) -> list[FloatArray]:
    rng = np.random.default_rng(seed)
    places = rng.uniform(-5.0, 5.0, (steps, 2))
    starts = rng.uniform(-5.0, 5.0, (robots, 2))
    return tables_of(places, starts, tuple(rng.uniform(0.5, 1.5, robots).tolist()))


def steps_of(count: int, *precedences: tuple[int, int], first_group: int = 0) -> Steps:
    before = np.zeros((count, count), dtype=bool)
    for early, late in precedences:
        before[early, late] = True
    groups = [tuple(range(first_group)), tuple(range(first_group, count))]
    return Steps.of(Ordering(tuple(filter(None, groups)), before))


def time_of(table: FloatArray, order: tuple[int, ...]) -> float:
    rows = (0, *(step + 1 for step in order))
    return math.fsum(table[row, step] for row, step in zip(rows, order, strict=False))


def every_division(robots: int, steps: Steps) -> list[tuple[tuple[int, ...], ...]]:
    """Return all orders of all robots that keep the precedences."""
    count = len(steps.before)
    found = []
    for owners in itertools.product(range(robots), repeat=count):
        pairs = np.argwhere(steps.before).tolist()
        if any(owners[early] != owners[late] for early, late in pairs):
            continue
        own = [[step for step in range(count) if owners[step] == robot] for robot in range(robots)]
        for orders in itertools.product(*map(itertools.permutations, own)):
            ordered = all(
                not steps.after[late, early]
                for order in orders
                for early, late in itertools.combinations(order, 2)
            )
            if ordered:
                found.append(orders)
    return found


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    "steps",
    [steps_of(5), steps_of(5, (0, 3), (3, 4)), steps_of(5, first_group=2)],
    ids=["free", "precedences", "groups"],
)
@pytest.mark.parametrize("total", [False, True])
def test_no_division_of_few_steps_is_better(seed: int, steps: Steps, total: bool) -> None:
    tables = random_tables(2, 5, seed)
    divisions = every_division(2, steps)
    costs = []
    for orders in divisions:
        times = [time_of(table, order) for table, order in zip(tables, orders, strict=True)]
        costs.append((sum(times), 0.0) if total else (max(times), sum(times)))
    found = divide(tables, steps, total=total)
    assert found.orders in divisions
    for table, order, time in zip(tables, found.orders, found.times, strict=True):
        assert time == pytest.approx(time_of(table, order))
    least = min(costs)
    assert (sum if total else max)(found.times) == pytest.approx(least[0])
    if not total:
        assert sum(found.times) == pytest.approx(least[1])


def test_a_precedence_holds_also_between_calls_that_keep_their_places() -> None:
    ordering = ordering_of_calls(["fetch", "deliver"], [False, False], [(), (0,)])
    tables = tables_of(
        np.array([[-5.0, 0.0], [5.0, 0.0]]), np.array([[-4.0, 0.0], [4.0, 0.0]]), (1.0, 1.0)
    )
    orders = divide(tables, Steps.of(ordering)).orders
    assert (0, 1) in orders


def test_the_nearer_of_two_equal_robots_goes() -> None:
    places, starts = np.array([[1.0, 0.0], [9.0, 0.0]]), np.array([[0.0, 0.0], [10.0, 0.0]])
    found = divide(tables_of(places, starts, (1.0, 1.0)), steps_of(2))
    assert found.orders == ((0,), (1,))
    assert found.times == pytest.approx((1.0, 1.0))


def test_a_fast_robot_does_more_than_a_slow_one() -> None:
    places = np.array([[float(x), 0.0] for x in range(1, 7)])
    starts = np.zeros((2, 2))
    fast, slow = divide(tables_of(places, starts, (2.0, 0.1)), steps_of(6)).orders
    assert fast == (0, 1, 2, 3, 4, 5)
    assert slow == ()


@pytest.mark.parametrize("count", [6, MOST_EXACT + 4])
def test_a_robot_gets_only_what_it_can_do(count: int) -> None:
    tables = random_tables(2, count, 3)
    tables[0][:, ::2] = np.nan
    first, second = divide(tables, steps_of(count)).orders
    assert not set(first) & set(range(0, count, 2))
    assert sorted((*first, *second)) == list(range(count))


def test_a_step_that_no_robot_can_execute_is_refused() -> None:
    tables = random_tables(2, 4, 1)
    for table in tables:
        table[:, 2] = np.inf
    with pytest.raises(DivisionError, match=r"^step 3: expected a robot that can execute it"):
        divide(tables, steps_of(4))


def test_steps_that_must_follow_each_other_need_one_robot_that_can_do_both() -> None:
    tables = random_tables(2, 3, 1)
    tables[0][:, 0] = np.inf
    tables[1][:, 1] = np.inf
    assert divide(tables, steps_of(3)).orders[0]
    with pytest.raises(DivisionError, match="keeps the precedences"):
        divide(tables, steps_of(3, (0, 1)))


def test_many_steps_keep_their_precedences_and_take_little_longer_than_the_best() -> None:
    count = MOST_EXACT + 6
    rng = np.random.default_rng(5)
    places = rng.uniform(-5.0, 5.0, (count, 2))
    steps = steps_of(count, (0, 1), (1, 2), (3, 4))
    tables = tables_of(places, np.array([[-5.0, 0.0], [5.0, 0.0], [0.0, 5.0]]), (1.0, 1.0, 1.0))
    found = divide(tables, steps)
    assert sorted(step for order in found.orders for step in order) == list(range(count))
    for early, late in ((0, 1), (1, 2), (3, 4)):
        (order,) = (order for order in found.orders if late in order)
        assert order.index(early) < order.index(late)


@pytest.mark.parametrize("seed", range(3))
def test_two_halves_far_apart_are_divided_as_if_each_were_alone(seed: int) -> None:
    half = MOST_EXACT // 2 + 2
    tables = random_tables(1, half, seed)[0]
    far = np.full_like(tables[1:], 1e4)
    both = [
        np.block([[tables[:1], far[:1]], [tables[1:], far], [far, tables[1:]]]),
        np.block([[far[:1], tables[:1]], [tables[1:], far], [far, tables[1:]]]),
    ]
    alone = divide([tables], steps_of(half))
    found = divide(both, steps_of(2 * half))
    assert sorted(found.orders[0]) == list(range(half))
    assert max(found.times) <= 1.02 * alone.times[0]
