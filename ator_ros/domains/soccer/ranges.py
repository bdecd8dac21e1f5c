"""The ranges of goal variables in soccer: places on the field, speeds that were learned."""

from __future__ import annotations

import functools
from types import MappingProxyType

from ator_ros.actions.base import Goal
from ator_ros.robot.description import Robot
from ator_ros.tops.ranges import ROBOT_RANGES, Range, Ranges, arrival_speed

ARRIVAL_SPEED = 0.8
"""Greatest arrival speed in m/s that is searched, and that situations to learn from are drawn with."""


def _along(robot: Robot, goal: Goal) -> Range:  # noqa: ARG001
    return Range(-robot.field.length / 2, robot.field.length / 2, 16)


def _across(robot: Robot, goal: Goal) -> Range:  # noqa: ARG001
    return Range(-robot.field.width / 2, robot.field.width / 2, 10)


RANGES: Ranges = MappingProxyType(
    {
        **ROBOT_RANGES,
        "x": _along,
        "y": _across,
        "speed": functools.partial(arrival_speed, most=ARRIVAL_SPEED),
    }
)
