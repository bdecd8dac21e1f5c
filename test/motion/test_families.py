"""Families of ideal motions: for any robot they are nearly as fast as a fine grid."""

from __future__ import annotations

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
from ator_ros.geometry import FloatArray
from ator_ros.motion.families import (
    MOST,
    Family,
    FreeTurns,
    drawn_ends,
    fastest_motions,
)
from ator_ros.robot.description import Limits, Robot


def ends(limits: Limits, count: int = 150) -> FloatArray:
    """Return starts and goals on the field, (5, 1, n), independent of those that kinds are chosen with."""
    return drawn_ends(limits, count, np.random.default_rng(1))


def excess(family: Family, grid: Family, robot: Robot) -> float:
    """Return the mean relative excess of a family's durations over those of a grid."""
    drawn = ends(family.limits)
    mine, best = (fastest_motions(drawn, some, hold=robot.hold).time for some in (family, grid))
    assert np.isfinite(mine).all()
    return float(np.mean(mine) / np.mean(np.minimum(mine, best)) - 1.0)


@pytest.mark.parametrize("robot", [PIONEER, PLAIN], ids=lambda robot: robot.name)
def test_drives_are_nearly_as_fast_as_those_of_the_grid(robot: Robot) -> None:
    limits, rows = robot.limits, turns_of(chosen_drives(robot), "drive", FreeTurns)
    assert len(rows) <= MOST
    grid = drive_family(limits, free_grid((0.0,)))
    assert excess(drive_family(limits, rows), grid, robot) < 0.004


@pytest.mark.parametrize("robot", [PIONEER, OTHERS[-1]], ids=lambda robot: robot.name)
def test_dribbles_are_nearly_as_fast_as_those_of_the_grid(robot: Robot) -> None:
    rows = turns_of(chosen_dribbles(robot), "dribble", PushedTurns)
    grid = dribble_family(robot, pushed_grid(robot))
    assert len(rows) <= MOST
    assert excess(dribble_family(robot, rows), grid, robot) < 0.02
