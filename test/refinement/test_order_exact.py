"""No order of a round is better than the one found: with shipped models, in hall and building."""

import dataclasses
import itertools
import math
from functools import cache

import numpy as np
import pytest

from ator_ros.actions.goal_variables import ORDER, with_values
from ator_ros.domains.domain import Domain, find_domain
from ator_ros.domains.trials import random_trial
from ator_ros.evaluation.toolset import ToolsetSource, tools_of
from ator_ros.geometry import FloatArray, IntArray
from ator_ros.refinement.refiner import Refinement, Refiner
from ator_ros.refinement.step_durations import predict_durations
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.ordering import Ordering, ordering_of
from ator_ros.world.state import RobotState, World

HEADINGS = np.linspace(-math.pi, math.pi, 12, endpoint=False)
# A search between the headings of the grid lowers the cost of a round by less than this share.
NEAR = 1.03


@cache
def setting(name: str) -> tuple[Domain, TopLibrary, Refiner]:
    tools, library = tools_of(ToolsetSource(domain=name))
    return find_domain(name), library, tools.refiner()


def random_round(name: str, count: int, seed: int) -> tuple[World, TopChain]:
    """Draw stations, some of which keep their place or heading, or come after another one."""
    domain, library, _ = setting(name)
    rng = np.random.default_rng([seed, count])
    calls = []
    for number in range(count):  # one place of each of several random rounds
        trial = random_trial(domain, "round", library, seed=seed, index=number)
        opened = frozenset({"yaw", ORDER})
        if rng.random() < 0.1:
            opened -= {ORDER}
        if rng.random() < 0.2:
            opened -= {"yaw"}
        after = (int(rng.integers(number)),) if number and rng.random() < 0.15 else ()
        calls.append(dataclasses.replace(trial.chain.calls[0], open=opened, after=after))
    return trial.world, TopChain(tuple(calls))


def closed(chain: TopChain, order: tuple[int, ...]) -> TopChain:
    calls = (chain.calls[index] for index in order)
    return TopChain(
        tuple(dataclasses.replace(each, open=each.open - {ORDER}, after=()) for each in calls)
    )


def orders_of(ordering: Ordering) -> IntArray:
    every = itertools.permutations(range(len(ordering.before)))
    return np.array([order for order in every if ordering.fault(order) is None])


def least_on_grid(world: World, chain: TopChain, orders: IntArray, refiner: Refiner) -> FloatArray:
    """Return the predicted duration of each order with the best headings on the grid."""
    turned = [
        [dataclasses.replace(each, goal=with_values(each.goal, {"yaw": yaw})) for yaw in options]
        for each in chain.calls
        for options in [HEADINGS if "yaw" in each.open else [each.goal.pose.yaw] * len(HEADINGS)]
    ]
    ends = [World(0.0, RobotState(each.goal.pose)) for own in turned for each in own]
    flat = [each for own in turned for each in own]
    found = predict_durations([world, *ends], flat, refiner.models).durations
    count, size = len(chain), len(HEADINGS)
    first = found[0].reshape(count, size)
    legs = found[1:].reshape(count, size, count, size)
    sums = first[orders[:, 0]]
    for place in range(1, count):
        costs = legs[orders[:, place - 1], :, orders[:, place]]
        sums = (sums[:, :, None] + costs).min(axis=1)
    return np.asarray(sums.min(axis=1))


def expect_no_better_order(name: str, count: int, seed: int) -> None:
    _, _, refiner = setting(name)
    world, chain = random_round(name, count, seed)

    def refined(sent: TopChain) -> Refinement:
        return refiner.refine(world, sent, placeholders=True)

    found = refined(chain)
    ordering = ordering_of(chain)
    assert ordering.fault(found.best.order) is None
    orders = orders_of(ordering)
    on_grid = least_on_grid(world, chain, orders, refiner)
    promising = orders[on_grid <= NEAR * on_grid.min()]
    least = min(refined(closed(chain, tuple(order))).after.cost for order in promising.tolist())
    as_sent = refined(closed(chain, tuple(range(count))))
    assert found.before.cost == pytest.approx(as_sent.before.cost)
    assert found.after.cost <= 1.001 * least
    assert found.after.cost <= as_sent.after.cost + 1e-6


def test_in_the_hall() -> None:
    expect_no_better_order("tour", 5, seed=1)


def test_in_the_building() -> None:
    expect_no_better_order("building", 4, seed=1)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(25))
@pytest.mark.parametrize("count", [4, 5, 6, 7])
@pytest.mark.parametrize("name", ["tour", "building"])
def test_of_200_rounds(name: str, count: int, seed: int) -> None:
    expect_no_better_order(name, count, seed=100 + seed)
