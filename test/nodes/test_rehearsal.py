"""Rehearsal: what a first goal needs has been computed before."""

from __future__ import annotations

from ator_ros.actions.planned import turns
from ator_ros.execution.predictions import Predictor
from ator_ros.execution.rehearsal import rehearse
from ator_ros.robot.description import load_robot
from ator_ros.tops.library import TopLibrary


def test_a_second_rehearsal_finds_all_tables() -> None:
    robot = load_robot()
    library, predictor = TopLibrary(robot), Predictor(robot, {})
    rehearse(robot, library, predictor)
    before = turns._table.cache_info().misses
    rehearse(robot, library, predictor)
    assert before > 0
    assert turns._table.cache_info().misses == before
