"""Each node is killed at each stage of a chain and started again: the robot stands, a new goal works."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import pytest
from arena import Arena, arena_with
from selection import few
from stages import MOVING, STAGES, Stage, dribble, refining, waiting

from ator_interfaces.msg import Outcome

pytestmark = pytest.mark.node


@pytest.fixture(scope="module")
def arena(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Arena]:
    with arena_with(tmp_path_factory.mktemp("logs")) as made:
        made.start("simulation", "executor", "refinement")
        yield made


@pytest.fixture(autouse=True)
def awake(arena: Arena) -> Iterator[None]:
    """End every test with all nodes running, and with what must hold always."""
    yield
    arena.nodes["refinement"].send(signal.SIGCONT)
    arena.check()


def recovers(arena: Arena, name: str) -> None:
    """Start a node again and show that a new goal works."""
    arena.nodes["refinement"].send(signal.SIGCONT)
    arena.start(name)
    arena.visit().succeed()


@pytest.mark.long
@pytest.mark.parametrize("stage", few(STAGES, dribble))
def test_the_executor_is_killed(arena: Arena, stage: Stage) -> None:
    visit = arena.visit()
    stage(arena, visit)
    stops = len(arena.stops())
    arena.nodes["executor"].kill()
    if stage in MOVING:
        visit.ros.eventually(lambda: len(arena.stops()) > stops, "the robot stands")
    recovers(arena, "executor")


@pytest.mark.long
@pytest.mark.parametrize("stage", few(STAGES, dribble))
def test_the_simulation_is_killed(arena: Arena, stage: Stage) -> None:
    visit = arena.visit()
    sent = stage(arena, visit)
    arena.nodes["simulation"].kill()
    outcome = visit.ended(sent).outcome
    assert outcome.code == Outcome.INPUT_LOST
    assert "odom is missing" in outcome.reason
    recovers(arena, "simulation")


@pytest.mark.long
@pytest.mark.parametrize("stage", few(STAGES, refining))
def test_refinement_is_killed(arena: Arena, stage: Stage) -> None:
    visit = arena.visit()
    sent = stage(arena, visit)
    arena.nodes["refinement"].kill()
    if stage is waiting:
        visit.place()
    result = visit.ended(sent)
    assert result.outcome.code == Outcome.SUCCEEDED, result.outcome.reason
    if stage is refining:
        assert "executed as sent, refinement failed: no answer within 3 s" in result.record.refinement
    recovers(arena, "refinement")
