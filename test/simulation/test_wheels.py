"""The angles of the wheels, for drawing."""

from __future__ import annotations

import pytest

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.simulation.urdf import Wheels

ROBOT = SOCCER.robot()


def test_wheels_roll_with_the_base() -> None:
    wheels = Wheels(ROBOT)
    wheels.roll(0.0, 1.0, 0.0)
    wheels.roll(0.1, 0.5, 0.0)
    assert wheels.angles == pytest.approx([0.05 / ROBOT.wheel_radius] * 2)
    wheels.roll(0.2, 0.0, 1.0)
    turn = 0.1 * ROBOT.track / 2.0 / ROBOT.wheel_radius
    assert wheels.angles[1] - wheels.angles[0] == pytest.approx(2.0 * turn)
    before = list(wheels.angles)
    wheels.roll(0.1, 1.0, 0.0)  # a clock that goes back
    assert wheels.angles == before
