"""The oracle: the best chain that is found by changing one subgoal after another."""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import pytest

from ator_ros.actions.base import Goal
from ator_ros.domains.domain import find_domain
from ator_ros.domains.trials import random_trial
from ator_ros.evaluation.comparison import best_chain
from ator_ros.tops.chain import TopChain

DOMAIN = find_domain("tour")
CHAIN = random_trial(DOMAIN, "tour", DOMAIN.library(DOMAIN.robot()), seed=5, index=0).chain
STEPS = (0, 1, 2)


def headings(chain: TopChain) -> list[float]:
    return [chain.calls[step].goal.pose.yaw for step in STEPS]


def with_yaw(step: int, yaw: float) -> Goal:
    goal = CHAIN.calls[step].goal
    return dataclasses.replace(goal, pose=goal.pose._replace(yaw=yaw))


def options(count: int) -> dict[int, list[Goal]]:
    spaced = [2.0 * math.pi * k / count - 3.0 for k in range(count)]
    return {step: [with_yaw(step, yaw) for yaw in spaced] for step in STEPS}


def start(*yaws: float) -> TopChain:
    chain = CHAIN
    for step, yaw in enumerate(yaws):
        chain = chain.with_goal(step, with_yaw(step, yaw))
    return chain


class Executed:
    """Durations of chains by headings: each turn between two subgoals takes its angle in s."""

    def __init__(self) -> None:
        self.chains: set[tuple[float, ...]] = set()

    def __call__(self, chain: TopChain) -> float:
        first, second, third = headings(chain)
        self.chains.add((first, second, third))
        return 10.0 + abs(first - 1.0) + abs(second - first) + abs(third - second)


def single_changes(chain: TopChain, offered: Mapping[int, Sequence[Goal]]) -> list[TopChain]:
    return [chain.with_goal(step, goal) for step, goals in offered.items() for goal in goals]


@pytest.mark.parametrize("yaws", [(0.0, 0.0, 0.0), (-2.0, 1.0, 2.5), (3.0, -3.0, 3.0)])
def test_no_change_of_a_single_subgoal_is_faster(yaws: tuple[float, float, float]) -> None:
    executed = Executed()
    offered = options(6)
    best = best_chain([start(*yaws)], offered, duration=executed, predicted=executed)
    assert executed(best) <= executed(start(*yaws))
    assert all(executed(best) <= executed(each) for each in single_changes(best, offered))


def test_the_oracle_is_never_slower_than_its_fastest_start() -> None:
    executed = Executed()
    good = start(1.0, 1.0, 1.1)  # no option is as good
    best = best_chain(
        [start(0.0, 2.0, 0.0), good], options(3), duration=executed, predicted=executed
    )
    assert headings(best) == headings(good)


def test_with_one_open_subgoal_the_best_option_is_found() -> None:
    executed = Executed()
    offered = {1: options(12)[1]}
    best = best_chain([start(-1.0, 3.0, 0.5)], offered, duration=executed, predicted=executed)
    every = [start(-1.0, goal.pose.yaw, 0.5) for goal in offered[1]]
    assert executed(best) == min(executed(each) for each in every)
    assert headings(best)[0] == -1.0
    assert headings(best)[2] == 0.5


def test_the_first_of_equally_fast_starts_is_kept() -> None:
    starts = [start(0.0, 0.0, 0.0), start(1.0, 1.0, 1.0)]
    best = best_chain(starts, options(2), duration=lambda _: 5.0, predicted=lambda _: 5.0)
    assert best == starts[0]


def test_a_margin_saves_executions_and_keeps_the_best() -> None:
    every, few = Executed(), Executed()
    starts = [start(0.0, 0.0, 0.0)]
    predicted = Executed()
    whole = best_chain(starts, options(12), duration=every, predicted=predicted)
    part = best_chain(starts, options(12), duration=few, predicted=predicted, margin=0.2)
    assert every(whole) == few(part)
    assert len(few.chains) < 0.4 * len(every.chains)


def test_options_beyond_the_margin_are_not_executed_even_if_they_are_faster() -> None:
    executed = Executed()
    wrong = {-3.0: 1.0, 1.0: 1.5}
    offered = {0: [with_yaw(0, yaw) for yaw in wrong]}
    best = best_chain(
        [start(2.0, 1.0, 1.0)],
        offered,
        duration=executed,
        predicted=lambda chain: wrong[headings(chain)[0]],
        margin=0.4,
    )
    assert headings(best)[0] == 2.0
    within = best_chain(
        [start(2.0, 1.0, 1.0)],
        offered,
        duration=executed,
        predicted=lambda chain: wrong[headings(chain)[0]],
        margin=0.5,
    )
    assert headings(within)[0] == 1.0
