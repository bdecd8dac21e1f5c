"""The kinds of paths that are chosen for a robot are nearly as fast as all combinations of a fine grid."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
import pytest
from robots import OTHERS, PIONEER, PLAIN

from ator_ros.motion.families import Family, drawn_ends, fastest_motions
from ator_ros.performance.driving import ObservedLimits, chosen_kinds, free_kinds, restored_kind
from ator_ros.robot.description import Robot


@pytest.mark.parametrize("robot", [PIONEER, PLAIN, OTHERS[-1]], ids=lambda robot: robot.name)
def test_chosen_paths_are_nearly_as_fast_as_all_of_the_grid(robot: Robot) -> None:
    limits = ObservedLimits(**asdict(robot.limits))
    grid = Family(limits, tuple(free_kinds(limits)))
    chosen = Family(limits, tuple(map(restored_kind, chosen_kinds(grid, np.empty((5, 1, 0)), hold=0.0))))
    drawn = drawn_ends(limits, 150, np.random.default_rng(1))
    mine, best = (fastest_motions(drawn, some, hold=robot.hold).time for some in (chosen, grid))
    assert np.isfinite(mine).all()
    assert float(np.mean(mine) / np.mean(np.minimum(mine, best))) < 1.02
