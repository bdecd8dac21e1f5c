"""Direct variables of the steps of a chain, for many candidates at once."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from refinement_fakes import ROBOT, call, world

from ator_ros.actions.base import Goal, Point
from ator_ros.geometry import Pose
from ator_ros.refinement.chain_prediction import chain_situations, step_rows
from ator_ros.refinement.refiner import replaced
from ator_ros.tops.chain import Top, TopCall, TopChain
from ator_ros.tops.conditions import Condition, Term

NAMES = ("x", "yaw", "speed", "cruise")
OPENED = [names for count in range(len(NAMES) + 1) for names in itertools.combinations(NAMES, count)]


def chain(first: Point, second: Point) -> TopChain:
    goals = (
        Goal(Pose(0.5, -0.3, 0.7), 0.2, first, {"cruise": 0.4}),
        Goal(Pose(-1.0, 1.0, -2.0), 0.1, second, {"cruise": 0.6}),
    )
    calls = (call("goToPose", 0.0, 0.0, 0.0), call("dribbleBall", 0.0, 0.0, 0.0))
    return TopChain(tuple(dataclasses.replace(each, goal=g) for each, g in zip(calls, goals, strict=True)))


@pytest.mark.parametrize("point", [Point.AXLE, Point.HOLD])
@pytest.mark.parametrize("names", OPENED)
def test_candidates_have_the_rows_of_the_chains_that_they_make(point: Point, names: tuple[str, ...]) -> None:
    given, none = chain(point, Point.HOLD), np.zeros((1, 0))
    values = np.random.default_rng(4).uniform(-1.0, 1.0, (5, len(names)))
    leading, following = step_rows(world(), given, ROBOT, [names, ()])
    tables = [leading.table(none, values), following.table(values, none)]
    changes_start = bool({"x", "yaw", "speed"} & set(names))
    assert [table.table.shape[1] for table in tables] == [5 if names else 1, 5 if changes_start else 1]
    for row, candidate in enumerate(values):
        made = replaced(given, 0, dict(zip(names, candidate, strict=True)))
        for table, alone in zip(tables, chain_situations(world(), made, ROBOT), strict=True):
            assert table.names == alone.names
            column = table.table[:, row if table.table.shape[1] > 1 else 0]
            assert column.tolist() == alone.table[:, 0].tolist()


def test_a_step_that_only_turns_is_followed_from_where_the_robot_stands() -> None:
    turn = Top("turn", "turn", Condition(), Condition((Term("robot.yaw", "goal.yaw", 0.1),)))
    calls = TopCall(turn, Goal(Pose(0.0, 0.0, 1.5))), call("goToPose", 1.0, 1.0, 0.0)
    table = chain_situations(world(x=-1.0, y=0.5), TopChain(calls), ROBOT)[1]
    assert [float(table[name][0]) for name in ("x", "y", "yaw")] == [-1.0, 0.5, 1.5]
