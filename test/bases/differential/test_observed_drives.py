"""What drives show of an action, and paths that do not depend on one another."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from experience_rows import synthetic_experience

from ator_ros.bases.description import load_robot
from ator_ros.bases.differential.driving import plain_driving
from ator_ros.bases.differential.observation import backward_above
from ator_ros.bases.direct import DIRECT_VARIABLES
from ator_ros.bases.drive_parts import part_times
from ator_ros.performance.derived import Geometry

ROBOT = load_robot()
ROWS = synthetic_experience("goToPose", episodes=40)


def direct(**values: Any) -> dict[str, Any]:
    return {**dict.fromkeys(DIRECT_VARIABLES, 0.0), **values}


def test_a_path_does_not_depend_on_the_other_situations() -> None:
    plain = plain_driving(ROBOT.limits)
    table = direct(
        xg=np.array([1.0, 2.0, 1.5, -1.0]),
        yg=np.array([0.5, -0.5, 1.0, 0.2]),
        yawg=np.array([0.3, 2.0, -1.0, 3.0]),
        hold=np.array([1.0, 0.0, 1.0, 0.0]),
    )
    approaching = dataclasses.replace(plain, approaches=plain.drives, run=0.3, passing=0.4)
    forward = dataclasses.replace(plain, forward=True)
    for driving in (plain, approaching, forward):
        together = Geometry(table, ROBOT, driving).path
        for number in range(4):
            alone = {
                name: np.atleast_1d(each)[number % np.size(each)] for name, each in table.items()
            }
            assert together[:, number] == pytest.approx(Geometry(alone, ROBOT, driving).path[:, 0])


def test_parts_add_up_and_impossible_ones_are_unknown() -> None:
    rows = ROWS.iloc[:3].assign(
        duration=[5.0, 5.0, 5.0], first_turn=[1.0, 3.0, np.nan], last_turn=[1.5, 3.0, 1.0]
    )
    parts = part_times(rows)
    assert parts[0] == pytest.approx([1.0, 2.5, 1.5])
    assert np.isnan(parts[1]).all()
    assert np.isnan(parts[2, :2]).all()


def test_the_angle_above_which_drives_are_backward_has_fewest_drives_on_the_wrong_side() -> None:
    angles = np.linspace(0.1, 3.0, 30)
    rows = ROWS.iloc[:30].assign(x=0.0, y=0.0, yaw=angles, xg=2.0, yg=0.0)
    driven = np.where(angles > 2.0, -2.0, 2.0)
    border = backward_above(rows.assign(driven=driven), ROBOT)
    assert border == pytest.approx((angles[angles <= 2.0].max() + angles[angles > 2.0].min()) / 2.0)
    assert backward_above(rows.assign(driven=2.0), ROBOT) == math.pi
    assert backward_above(rows.assign(driven=-2.0), ROBOT) == math.pi
    # two of thirty on the wrong side: no angle separates them
    mixed = driven.copy()
    mixed[[0, 3]] = -2.0
    assert backward_above(rows.assign(driven=mixed), ROBOT) == math.pi
    # short drives and goals nearby do not count
    unclear = driven.copy()
    unclear[[0, 3]] = -0.05
    assert backward_above(rows.assign(driven=unclear), ROBOT) == pytest.approx(border)
    near = rows.assign(driven=mixed)
    near.loc[[0, 3], "x"] = 1.8
    assert backward_above(near, ROBOT) == pytest.approx(border)
