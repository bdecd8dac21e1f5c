"""Families of ideal motions: those of any robot are nearly as fast as all combinations of a fine grid."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from robots import OTHERS, PIONEER, PLAIN

from ator_ros.domains.soccer.features import (
    PushedTurns,
    chosen_dribbles,
    chosen_drives,
    dribble_family,
    drive_family,
    free_grid,
    pushed_grid,
    turns_of,
)
from ator_ros.domains.soccer.planned.holding import MARGIN, keeps_ball, push
from ator_ros.geometry import FloatArray
from ator_ros.motion.displacements import TurnDriving
from ator_ros.motion.families import (
    MOST,
    Family,
    FreeTurns,
    drawn_ends,
    fastest_motions,
)
from ator_ros.performance.features import Kinds
from ator_ros.robot.description import Limits, Robot

every_robot = pytest.mark.parametrize("robot", [PIONEER, OTHERS[-1]], ids=lambda robot: robot.name)


def ends(limits: Limits, count: int = 150) -> FloatArray:
    """Return starts and destinations on the field, (5, 1, n); others than kinds are chosen with."""
    return drawn_ends(limits, count, np.random.default_rng(1))


def excess(family: Family, grid: Family, robot: Robot) -> float:
    """Return by how much a family's motions are longer in the mean than those of a grid, as a share."""
    drawn = ends(family.limits)
    mine, best = (fastest_motions(drawn, some, hold=robot.hold).time for some in (family, grid))
    assert np.isfinite(mine).all()
    return float(np.mean(mine) / np.mean(np.minimum(mine, best)) - 1.0)


@cache
def drives_of(robot: Robot) -> Kinds:
    return chosen_drives(robot)


@cache
def dribbles_of(robot: Robot) -> tuple[PushedTurns, ...]:
    return turns_of(chosen_dribbles(robot), "dribble", PushedTurns)


@pytest.mark.parametrize("robot", [PIONEER, PLAIN], ids=lambda robot: robot.name)
def test_drives_are_nearly_as_fast_as_those_of_the_grid(robot: Robot) -> None:
    limits, rows = robot.limits, turns_of(drives_of(robot), "drive", FreeTurns)
    assert len(rows) <= MOST
    grid = drive_family(limits, free_grid((0.0,)))
    assert excess(drive_family(limits, rows), grid, robot) < 0.004


@every_robot
def test_dribbles_are_nearly_as_fast_as_those_of_the_grid(robot: Robot) -> None:
    rows, grid = dribbles_of(robot), dribble_family(robot, pushed_grid(robot))
    assert len(rows) <= MOST
    assert excess(dribble_family(robot, rows), grid, robot) < 0.02


@every_robot
def test_turns_with_the_ball_hold_it(robot: Robot) -> None:
    fastest = robot.holder_for("a test").limits.v
    for rows in (None, dribbles_of(robot)):
        family = dribble_family(robot) if rows is None else dribble_family(robot, rows)
        for kind in family.kinds:
            entry = max(kind.least_start, 0.0) if np.isnan(kind.entry) else kind.entry
            assert push(robot, entry, kind.first.rate, kind.first.change) >= MARGIN
            after = max(kind.least_arrival, 0.0) if np.isnan(kind.share) else kind.share * fastest
            assert push(robot, after, kind.last.rate, -kind.last.change) >= MARGIN
            turn = TurnDriving(entry, kind.first.change, kind.first.rate)
            assert rows is None or keeps_ball(robot, turn, fastest)
