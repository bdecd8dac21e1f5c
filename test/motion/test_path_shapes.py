"""The shapes of paths that are chosen for a robot are nearly as fast as all combinations of a fine grid."""

from __future__ import annotations

import numpy as np
import pytest
from robots import OTHERS, PIONEER, PLAIN

from ator_ros.motion.durations import rates_of
from ator_ros.motion.shapes import Rules, drawn_ends, fastest_paths, shape_set
from ator_ros.performance.driving import free_shapes, plain_driving
from ator_ros.robot.description import Robot


@pytest.mark.parametrize("robot", [PIONEER, PLAIN, OTHERS[-1]], ids=lambda robot: robot.name)
def test_chosen_paths_are_nearly_as_fast_as_all_of_the_grid(robot: Robot) -> None:
    limits = robot.limits
    grid = shape_set([[shape] for shape in free_shapes(limits)], Rules(rates_of(limits)))
    chosen = plain_driving(robot).drive_paths
    far = np.array([[3.0, 1.0], [0.0, 0.0], [0.0, 0.0], [0.0, limits.v], [limits.v, 0.0]])
    drawn = drawn_ends(far, 150, np.random.default_rng(1))
    mine, best = (fastest_paths(drawn, some, hold=robot.hold)[0] for some in (chosen, grid))
    assert np.isfinite(mine).all()
    assert float(np.mean(mine) / np.mean(np.minimum(mine, best))) < 1.02
