"""Rehearsal: what a first goal needs has been computed, and compiled, before."""

from __future__ import annotations

import pytest

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.planned import planner, run_up, screening, turns, ways
from ator_ros.execution.predictions import Predictor
from ator_ros.execution.rehearsal import rehearse
from ator_ros.robot.description import load_robot


def test_a_second_rehearsal_finds_all_tables() -> None:
    robot = load_robot()
    library, predictor = SOCCER.library(robot), Predictor(robot, {})
    kept = (turns._kept_headings, run_up._kept_table, ways._stored_table)
    rehearse(robot, library, predictor)
    before = [table.cache_info().misses for table in kept]
    assert min(before) > 0
    # Rates that only some speed of a start allows: their headings are there before one has it.
    assert turns._kept_headings.cache_info().currsize > 20
    rehearse(robot, library, predictor)
    assert [table.cache_info().misses for table in kept] == before


def test_a_rehearsal_searches_to_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    called = dict.fromkeys(("judge", "touch", "closed", "is_clear"), 0)
    for module, name in (
        (screening, "judge"), (screening, "touch"), (planner, "closed"), (planner, "is_clear"),
    ):  # fmt: skip
        original = getattr(module, name)

        def counted(*arguments, name=name, original=original):  # type: ignore[no-untyped-def]
            called[name] += 1
            return original(*arguments)

        monkeypatch.setattr(module, name, counted)
    robot = load_robot()
    rehearse(robot, SOCCER.library(robot), Predictor(robot, {}))
    assert min(called.values()) > 0
