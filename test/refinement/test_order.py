"""The order of a chain, its headings and speeds are chosen together, and are the best."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from refinement_fakes import (
    ANGLE,
    NOTHING,
    ROBOT,
    USED,
    FakeModel,
    after,
    call,
    models,
    turning_time,
    world,
)

from ator_ros.actions.goal_variables import ORDER
from ator_ros.geometry import BoolArray, FloatArray, Pose, wrap_angle
from ator_ros.refinement import RefinementError
from ator_ros.refinement.order import MOST_EXACT
from ator_ros.refinement.order_search import (
    MOST_TRIED,
    LocalSearch,
    best_orders,
    nearest_next,
)
from ator_ros.refinement.refiner import ITS_DEADLINE, LONGEST_CHAIN, Refinement, Refiner, choose
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.ordering import ordering_of
from ator_ros.world.state import RobotState, World

OPEN = ANGLE | {ORDER}
REFINER = Refiner(ROBOT, models())


def stop(
    x: float, y: float, *after: int, opened: frozenset[str] = OPEN, yaw: float = 0.0
) -> TopCall:
    return dataclasses.replace(call("goToPose", x, y, yaw, opened), after=after)


def random_round(count: int, seed: int) -> TopChain:
    """Draw stops, some of which keep their place or heading, or must come after another one."""
    rng = np.random.default_rng(seed)
    calls = []
    for index in range(count):
        place = rng.uniform(-4.0, 4.0, 2)
        opened = OPEN
        if rng.random() < 0.15:
            opened -= {ORDER}
        if rng.random() < 0.2:
            opened -= ANGLE
        yaw = float(rng.uniform(-math.pi, math.pi))
        calls.append(stop(float(place[0]), float(place[1]), opened=opened, yaw=yaw))
        if index and rng.random() < 0.2:
            calls[index] = dataclasses.replace(calls[index], after=(int(rng.integers(index)),))
    return TopChain(tuple(calls))


def closed(chain: TopChain) -> TopChain:
    """Return a chain whose order is as it is."""
    return dataclasses.replace(
        chain,
        calls=tuple(
            dataclasses.replace(each, open=each.open - {ORDER}, after=()) for each in chain.calls
        ),
    )


def refined(chain: TopChain, start: World | None = None) -> Refinement:
    return REFINER.refine(start or world(), chain, placeholders=True)


def expect_best(chain: TopChain) -> None:
    ordering = ordering_of(chain)
    found = refined(chain)
    least = math.inf
    for order in itertools.permutations(range(len(chain))):
        if ordering.fault(order) is None:
            other = refined(closed(chain.reordered(order)))
            least = min(least, other.after.cost)
    as_sent = refined(closed(chain))
    assert found.before.cost == pytest.approx(as_sent.before.cost)
    assert found.after.cost <= 1.001 * least
    assert found.after.cost <= as_sent.after.cost + 1e-4
    assert ordering.fault(found.best.order) is None


@pytest.mark.parametrize("seed", range(3))
def test_no_order_is_better(seed: int) -> None:
    expect_best(random_round(5, seed))


@pytest.mark.long
@pytest.mark.parametrize("seed", range(20))
def test_no_order_of_six_is_better(seed: int) -> None:
    expect_best(random_round(6, 50 + seed))


@pytest.mark.long
@pytest.mark.parametrize("seed", range(6))
def test_no_order_of_seven_is_better(seed: int) -> None:
    expect_best(random_round(7, 100 + seed))


def test_stations_in_a_line_are_visited_along_it() -> None:
    xs = (3.0, 1.0, 4.0, 0.0, 2.0)
    found = refined(TopChain(tuple(stop(x, 0.0) for x in xs)))
    assert found.refined
    assert found.best.order == (3, 1, 4, 0, 2)
    assert found.chain.order == found.best.order
    assert found.original.order == (0, 1, 2, 3, 4)
    headings = [each.goal.pose.yaw for each in found.best.calls]
    assert headings == pytest.approx([0.0] * 5, abs=math.radians(2))
    assert "best order 4, 2, 5, 1, 3" in found.reason


def test_a_round_ends_where_its_last_step_keeps_its_place() -> None:
    """By hand: from x = -1 to the stop at 4, back to the fixed end at 0, the others on the way."""
    chain = TopChain((stop(2.0, 0.0), stop(4.0, 0.0), stop(0.0, 0.0, opened=NOTHING, yaw=math.pi)))
    assert refined(chain).best.order == (0, 1, 2)
    listed = TopChain((chain.calls[1], chain.calls[0], chain.calls[2]))
    assert refined(listed).after.cost == pytest.approx(refined(chain).after.cost, abs=1e-3)


@pytest.mark.parametrize("seed", range(2))
def test_the_cost_does_not_depend_on_how_stations_are_listed_or_mirrored(seed: int) -> None:
    chain = random_round(5, seed)
    chain = TopChain(tuple(stop(*each.goal.pose[:2]) for each in chain.calls))
    found = refined(chain)
    listed = refined(TopChain(chain.calls[::-1]))
    assert listed.after.cost == pytest.approx(found.after.cost, rel=5e-4)
    mirrored = refined(TopChain(tuple(stop(c.goal.pose.x, -c.goal.pose.y) for c in chain.calls)))
    assert mirrored.after.cost == pytest.approx(found.after.cost, rel=5e-4)
    assert mirrored.best.order == found.best.order
    pairs = zip(mirrored.best.calls, found.best.calls, strict=True)
    turned = [one.goal.pose.yaw + other.goal.pose.yaw for one, other in pairs]
    assert [wrap_angle(sum_) for sum_ in turned] == pytest.approx([0.0] * 5, abs=0.1)


def test_speeds_are_chosen_with_the_order() -> None:
    opened = OPEN | {"speed"}
    chain = TopChain(tuple(stop(x, 0.0, opened=opened) for x in (2.0, 0.0, 1.0)))
    found = refined(chain)
    assert found.best.order == (1, 2, 0)
    assert found.best.calls[0].goal.speed == pytest.approx(0.45, abs=0.02)


def test_an_order_that_no_condition_allows_is_not_considered() -> None:
    """The dribble is nearer than the ball, but starts with the ball held."""
    chain = TopChain(
        (
            call("goToBall", 2.0, 0.0, 0.0, OPEN),
            call("dribbleBall", 1.0, 0.5, 0.0, OPEN),
            stop(0.0, 0.0),
        )
    )
    here = world(ball=(2.0, 0.0))
    found = refined(chain, here)
    assert found.best.order == (2, 0, 1)
    choice = choose(REFINER, here, [TopChain(chain.calls[::-1])], placeholders=True)
    assert choice.refinement.best.order == (0, 2, 1) or not choice.refinement.refined
    assert choice.refinement.after.cost == pytest.approx(found.after.cost, abs=1e-3)
    with pytest.raises(RefinementError, match="no valid plan: in no order: pre-condition of step"):
        choose(REFINER, world(ball=(5.0, 0.0)), [chain])
    with pytest.raises(RefinementError, match="no valid plan: after: expected no circle"):
        choose(REFINER, here, [TopChain((stop(0.0, 0.0, 1), stop(1.0, 0.0, 0)))])


def test_what_is_free_is_named_by_the_call_that_was_sent() -> None:
    xs = (2.0, 0.0, 1.0)
    opened = (OPEN, OPEN - ANGLE, OPEN)
    found = refined(
        TopChain(tuple(stop(x, 0.0, opened=o) for x, o in zip(xs, opened, strict=True)))
    )
    assert found.best.order == (1, 2, 0)
    assert {each.subgoal for each in found.free} == {0, 2}
    assert {each.subgoal for each in found.curves} == {0, 2}


def test_more_time_gives_no_higher_cost_and_never_one_above_that_as_sent() -> None:
    chain = random_round(5, 3)
    full = refined(chain)
    assert full.complete
    for checks in range(120):
        found = REFINER.refine(world(), chain, placeholders=True, deadline=after(checks))
        assert found.after.cost <= found.before.cost + 1e-9
        assert ordering_of(chain).fault(found.best.order) is None
        if found.complete:
            assert found.after.cost == pytest.approx(full.after.cost)
            break
        assert ITS_DEADLINE in found.reason
    else:
        pytest.fail("expected a complete search")


@pytest.mark.parametrize("count", [6, 20, 50])
def test_a_search_that_is_cut_short_returns_the_best_order_found(count: int) -> None:
    """The deadline passes when the first table of legs is known, long before the end."""
    rng = np.random.default_rng(count)
    chain = TopChain(tuple(stop(*place) for place in rng.uniform(-4.0, 4.0, (count, 2)).tolist()))
    counted = Refiner(ROBOT, models())
    checks = 0

    def never() -> bool:
        nonlocal checks
        checks += 1
        return False

    full = counted.refine(world(), chain, placeholders=True, deadline=never)
    half = counted.refine(world(), chain, placeholders=True, deadline=after(checks // 2))
    assert not half.complete
    assert half.best.order != tuple(range(count))
    gained = (half.before.cost - half.after.cost) / (full.before.cost - full.after.cost)
    assert 0.8 < gained <= 1.0 + 1e-9


def test_values_that_were_sent_are_the_reference_if_they_are_no_placeholders() -> None:
    chain = TopChain((stop(1.0, 0.0, yaw=2.0), stop(0.0, 0.0, yaw=-2.0)))
    found = REFINER.refine(world(), chain)
    assert found.original == chain
    assert found.after.cost < refined(closed(chain)).after.cost


# The search on a table


def random_table(count: int, width: int, seed: int) -> FloatArray:
    """Return costs of legs between random places with random candidates, with a start."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(0.0, 10.0, (count + 1, 2))
    far = np.linalg.norm(places[:, None] - places[None, 1:], axis=2)
    turns = rng.uniform(0.0, 2.0, (count + 1, width, count, width))
    costs = far[:, None, :, None] + turns
    costs[0, 1:] = np.inf
    return np.asarray(costs)


def cost_of(costs: FloatArray, order: tuple[int, ...], rows: tuple[int, ...]) -> float:
    total = 0.0
    before = (0, 0)
    for index, row in zip(order, rows, strict=True):
        total += costs[before[0], before[1], index, row]
        before = (index + 1, row)
    return total


def least_cost(costs: FloatArray, order: tuple[int, ...]) -> float:
    width = costs.shape[1]
    return min(
        cost_of(costs, order, rows) for rows in itertools.product(range(width), repeat=len(order))
    )


@pytest.mark.parametrize("seed", range(4))
def test_the_best_orders_on_a_table_are_those_of_all_orders(seed: int) -> None:
    chain = random_round(5, seed)
    ordering = ordering_of(chain)
    costs = random_table(5, 2, seed)
    allowed = [order for order in itertools.permutations(range(5)) if ordering.fault(order) is None]
    expected = sorted(least_cost(costs, order) for order in allowed)
    found = best_orders(costs, ordering, None, 4)
    assert [each.cost for each in found[:2]] == pytest.approx(expected[: len(found[:2])])
    assert len(found) == min(4, len(allowed)) or len(found) >= 2
    for each in found:
        assert each.order in allowed
        assert each.cost == pytest.approx(cost_of(costs, each.order, each.rows))
        assert each.cost == pytest.approx(least_cost(costs, each.order))


def least_of_all_orders(costs: FloatArray, before: BoolArray) -> float:
    """Return the least cost of all orders that keep the precedences, by sets of calls."""
    count = len(before)
    least = {(frozenset({j}), j): costs[0, 0, j] for j in range(count) if not before[:, j].any()}
    for _ in range(count - 1):
        longer: dict[tuple[frozenset[int], int], FloatArray] = {}
        for (done, last), sums in least.items():
            for j in set(range(count)) - done:
                if not set(np.flatnonzero(before[:, j])) <= done:
                    continue
                total = (sums[:, None] + costs[last + 1, :, j]).min(axis=0)
                key = (done | {j}, j)
                longer[key] = np.minimum(longer.get(key, math.inf), total)
        least = longer
    return min(float(sums.min()) for sums in least.values())


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("count", [8, 9])
def test_up_to_nine_free_calls_with_several_headings_are_ordered_exactly(
    count: int, seed: int
) -> None:
    """The candidates of each call have random turns, so the best ones differ between legs."""
    rng = np.random.default_rng(seed)
    precedences = rng.integers(count, size=(seed, 2))
    after = {int(late): int(early) for early, late in precedences if early < late}
    calls = [stop(0.0, 0.0, *([after[j]] if j in after else [])) for j in range(count)]
    ordering = ordering_of(TopChain(tuple(calls)))
    costs = random_table(count, 4, seed)
    found = best_orders(costs, ordering, None, 1)[0]
    assert found.cost == pytest.approx(least_of_all_orders(costs, ordering.before))
    assert found.cost == pytest.approx(cost_of(costs, found.order, found.rows))
    assert ordering.fault(found.order) is None


def climb(search: LocalSearch) -> int:
    """Improve an order until no move does; return the number of parts that it takes."""
    cursor = 0
    parts = 0
    while cursor >= 0:
        cursor = search.improve(cursor, 1000)
        parts += 1
    return parts


def test_local_search_of_many_calls_returns_between_its_moves() -> None:
    """The deadline is checked between its parts."""
    chain = TopChain(tuple(stop(float(x), 0.0) for x in range(LONGEST_CHAIN)))
    costs = random_table(LONGEST_CHAIN, 2, seed=1)
    search = LocalSearch(costs, ordering_of(chain), range(LONGEST_CHAIN))
    near = 10 * LONGEST_CHAIN  # each call has ten near ones, each of which allows several moves
    assert climb(search) > near // MOST_TRIED
    best = search.cost
    climb(search)
    assert search.cost == best


@pytest.mark.parametrize("seed", range(3))
def test_after_a_climb_no_call_is_better_elsewhere(seed: int) -> None:
    """A call that was moved makes other moves worth trying again."""
    count = 30
    chain = TopChain(tuple(stop(float(x), 0.0) for x in range(count)))
    costs = random_table(count, 1, seed)
    search = LocalSearch(costs, ordering_of(chain), range(count))
    climb(search)
    search.kick()
    climb(search)
    order = search.order.tolist()
    legs = costs.min(axis=(1, 3))
    near = np.argsort(legs + np.vstack((np.zeros(count), np.diag([np.inf] * count))), axis=1)
    for number in order:
        others = [each for each in order if each != number]
        for place in range(count):
            moved = (*others[:place], number, *others[place:])
            before = others[place - 1] + 1 if place else 0
            if number in near[before, :10]:
                assert cost_of(costs, moved, (0,) * count) >= search.cost - 1e-9


@pytest.mark.parametrize("seed", range(5))
def test_local_search_is_near_the_best_order(seed: int) -> None:
    chain = random_round(MOST_EXACT, seed)
    ordering = ordering_of(chain)
    costs = random_table(MOST_EXACT, 3, seed)
    best = best_orders(costs, ordering, None, 1)[0]
    search = LocalSearch(costs, ordering, nearest_next(costs, ordering))
    climb(search)
    found = search.found()
    assert ordering.fault(found.order) is None
    assert found.cost == pytest.approx(cost_of(costs, found.order, found.rows))
    assert best.cost - 1e-9 <= found.cost <= 1.15 * best.cost


@pytest.mark.parametrize("seed", range(3))
def test_local_search_counts_the_cost_of_the_end(seed: int) -> None:
    """Two calls may be the last one, each with one candidate only."""
    count = 6
    chain = TopChain(tuple(stop(float(x), 0.0) for x in range(count)))
    ordering = ordering_of(chain)
    costs = random_table(count, 3, seed)
    end = np.full((count + 1, 3), np.inf)
    end[2, 1] = 0.0
    end[5, 2] = 1.0
    best = best_orders(costs, ordering, None, 1, end)[0]
    search = LocalSearch(costs, ordering, [1, 4, 0, 2, 3, 5], end)
    assert search.cost == np.inf
    climb(search)
    found = search.found()
    assert (found.order[-1], found.rows[-1]) in {(1, 1), (4, 2)}
    ending = end[found.order[-1] + 1, found.rows[-1]]
    assert found.cost == pytest.approx(cost_of(costs, found.order, found.rows) + ending)
    assert best.cost - 1e-9 <= found.cost <= 1.15 * best.cost


def test_nearest_next_lists_all_calls_also_where_no_leg_leads() -> None:
    chain = TopChain(tuple(stop(x, 0.0) for x in (1.0, 2.0, 3.0)))
    costs = random_table(3, 2, 1)
    costs[:, :, 1] = costs[2] = np.inf
    with np.errstate(invalid="raise"):
        assert sorted(nearest_next(costs, ordering_of(chain))) == [0, 1, 2]


def test_many_stations_in_a_line_are_visited_along_it() -> None:
    xs = np.random.default_rng(1).permutation(30) * 0.2
    found = refined(TopChain(tuple(stop(float(x), 0.0) for x in xs)))
    assert [each.goal.pose.x for each in found.best.calls] == sorted(xs)


def test_many_stations_keep_places_precedences_and_conditions() -> None:
    rng = np.random.default_rng(2)
    places = rng.uniform(-4.0, 4.0, (14, 2))
    calls = [stop(float(x), float(y)) for x, y in places]
    calls[3] = dataclasses.replace(calls[3], after=(9,))
    calls[12] = dataclasses.replace(calls[12], open=ANGLE)
    calls[5:7] = [call("goToBall", 1.0, 1.0, 0.0, OPEN), call("dribbleBall", -1.0, 1.0, 0.0, OPEN)]
    chain = TopChain(tuple(calls))
    here = world(ball=(1.0, 1.0))
    assert len(chain) > MOST_EXACT
    choice = choose(REFINER, here, [chain], placeholders=True)
    best = choice.refinement.best
    assert not best.violations(here, ROBOT)
    assert ordering_of(chain).fault(best.order) is None
    assert choice.refinement.after.cost < 0.75 * choice.refinement.before.cost


@pytest.mark.parametrize("seed", range(2))
def test_more_time_gives_no_higher_cost_of_many_steps_with_conditions(seed: int) -> None:
    """A ball is carried four times, with four drives between: few orders are valid."""
    rng = np.random.default_rng(seed)
    places = [(0.0, 0.0), (-1.0, 0.0), (3.5, 0.0), (-2.0, 0.0), (3.5, 1.0)]
    steps = [stop(float(x), float(y)) for x, y in rng.uniform(-3.0, 3.0, (4, 2))]
    for start, end in itertools.pairwise(places):
        steps.append(call("goToBall", *start, 0.0, OPEN))
        steps.append(call("dribbleBall", *end, 0.0, OPEN))
    chain = TopChain(tuple(steps))
    found = refined(chain)
    assert not found.best.violations(world(), ROBOT)
    for checks in (30, 60, 100, 200):
        cut = REFINER.refine(world(), chain, placeholders=True, deadline=after(checks))
        assert found.after.cost <= 1.001 * cut.after.cost


@pytest.mark.long
def test_the_longest_chain_is_ordered() -> None:
    cheap = Refiner(ROBOT, {"goToPose": FakeModel(turning_time, USED)})
    rng = np.random.default_rng(3)
    chain = TopChain(
        tuple(stop(*map(float, rng.uniform(-4.0, 4.0, 2))) for _ in range(LONGEST_CHAIN))
    )
    here = World(0.0, RobotState(Pose(0.0, 0.0, 0.0)))
    found = cheap.refine(here, chain, placeholders=True)
    assert sorted(found.best.order) == list(range(LONGEST_CHAIN))
    assert found.after.cost < 0.4 * found.before.cost


@pytest.mark.long
@pytest.mark.parametrize("seed", range(2))
def test_thirty_stations_are_within_two_percent_of_the_best_known_order(seed: int) -> None:
    """The best known order is that of four more searches, which begin with other orders."""
    cheap = Refiner(ROBOT, {"goToPose": FakeModel(turning_time, USED)})
    rng = np.random.default_rng(seed)
    chain = TopChain(tuple(stop(*map(float, rng.uniform(-4.0, 4.0, 2))) for _ in range(30)))
    found = cheap.refine(world(), chain, placeholders=True).after.cost
    others = [chain.reordered(rng.permutation(30).tolist()) for _ in range(4)]
    costs = [cheap.refine(world(), other, placeholders=True).after.cost for other in others]
    assert found <= 1.02 * min(costs)
