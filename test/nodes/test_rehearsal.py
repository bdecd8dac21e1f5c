"""Rehearsal: what a first goal needs has been computed before."""

from __future__ import annotations

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.planned import turns
from ator_ros.execution.predictions import Predictor
from ator_ros.execution.rehearsal import rehearse
from ator_ros.robot.description import load_robot


def test_a_second_rehearsal_finds_all_tables() -> None:
    robot = load_robot()
    library, predictor = SOCCER.library(robot), Predictor(robot, {})
    rehearse(robot, library, predictor)
    before = turns._table.cache_info().misses
    rehearse(robot, library, predictor)
    assert before > 0
    assert turns._table.cache_info().misses == before
