"""Nodes start in every order, goals are canceled and preempted at random moments, refinement is slow."""

from __future__ import annotations

import itertools
import random
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from arena import START, Arena, Visit, arena_with
from chain_client import Sent, call
from ros_client import Client
from selection import few
from stages import CHAIN

from ator_interfaces.msg import Outcome
from ator_interfaces.srv import RefineSubgoal

pytestmark = pytest.mark.node

SOMEWHERE = call("goToPose", START.ahead(-0.5))


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


@pytest.fixture(scope="module")
def late_answers(arena: Arena) -> Iterator[list[RefineSubgoal.Request]]:
    """Answer each request after its deadline, with another way to go; give the requests."""
    server = Client(arena.domain)
    requests: list[RefineSubgoal.Request] = []

    def answer(request: RefineSubgoal.Request, response: RefineSubgoal.Response) -> RefineSubgoal.Response:
        requests.append(request)
        time.sleep(1.5)
        response.accepted = response.refined = True
        response.chain.calls = [SOMEWHERE]
        return response

    server.node.create_service(RefineSubgoal, "refine_subgoal", answer)
    yield requests
    server.close()


def test_a_late_answer_of_refinement_is_no_answer(
    arena: Arena, late_answers: list[RefineSubgoal.Request]
) -> None:
    visit = arena.visit()
    visit.place()
    for _ in range(5):  # until the executor has discovered the service
        if late_answers:
            break
        visit.place()
        result = visit.ended(visit.send(CHAIN, refine=True))
    assert late_answers
    assert result.outcome.code == Outcome.SUCCEEDED, result.outcome.reason
    assert not result.record.refined
    assert "refinement failed: no answer within 1 s" in result.record.refinement
    assert [done.top for done in result.record.chain.calls] == [asked.top for asked in CHAIN]
    arena.check()


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
