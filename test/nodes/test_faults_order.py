"""Nodes start in every order, goals are canceled and preempted at random moments, refinement is slow."""

from __future__ import annotations

import itertools
import random
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from arena import Arena, Visit, arena_with
from chain_client import Sent
from selection import few
from stages import CHAIN

from ator_interfaces.msg import Outcome

pytestmark = pytest.mark.node

ORDERS = list(itertools.permutations(["executor", "refinement", "simulation"]))


@pytest.mark.long
@pytest.mark.parametrize("order", few(ORDERS, ORDERS[0]))
def test_nodes_start_in_any_order(order: tuple[str, ...], tmp_path: Path) -> None:
    with arena_with(tmp_path) as arena:
        for name in order:
            arena.start(name)
        visit = arena.visit()
        visit.place()
        result = visit.ended(visit.send(CHAIN[:1], refine=True))
        assert result.outcome.code == Outcome.SUCCEEDED, result.outcome.reason
        assert "refinement failed" not in result.record.refinement
        arena.check()


@pytest.fixture(scope="module")
def arena(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Arena]:
    """Yield simulation and executor; refinement is the test's own."""
    with arena_with(tmp_path_factory.mktemp("logs"), {"executor": {"refinement_timeout": 1.0}}) as made:
        made.start("simulation", "executor")
        yield made


@pytest.mark.parametrize("seed", few(range(6), 0, 1))
def test_goals_are_canceled_and_preempted_at_any_moment(arena: Arena, seed: int) -> None:
    """Send goals, each ended after a random time by a cancel or by the next goal; the last one succeeds."""
    draw = random.Random(seed)
    visit = arena.visit()
    visit.place()
    sent, canceled = [], set()
    for number in range(draw.randint(3, 6)):
        sent.append(visit.send([*CHAIN, *CHAIN[1:]], refine=draw.random() < 0.3))
        time.sleep(draw.choice((0.0, 0.01, draw.uniform(0.0, 0.8))))
        if draw.random() < 0.4 and canceling(visit, sent[-1]):
            canceled.add(number)
    visit.succeed()
    for number, goal in enumerate(sent):
        outcome = visit.ended(goal).outcome
        allowed = {Outcome.CANCELED} if number in canceled else {Outcome.PREEMPTED}
        # The next chain begins where the last one was broken off: it may fail before its time.
        assert outcome.code in allowed | {Outcome.REFUSED, Outcome.FAILED, Outcome.OBJECT_LOST}, (
            outcome.reason
        )
    arena.check()


def canceling(visit: Visit, sent: Sent) -> bool:
    """Ask for a goal's end and say whether it still ran."""
    future = visit.ros.within(sent.handle.cancel_goal_async)
    visit.ros.eventually(future.done, "an answer to cancel")
    return bool(future.result().goals_canceling)
