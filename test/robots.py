"""Robots unlike the Pioneer, for tests of what is derived from a robot's description."""

from __future__ import annotations

import dataclasses

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.robot.description import Limits, Robot

PIONEER = SOCCER.robot()


def _robot(name: str, limits: Limits, dribble_limits: Limits, **sizes: float) -> Robot:
    holder = dataclasses.replace(PIONEER.holder_for("a test"), limits=dribble_limits)
    return dataclasses.replace(PIONEER, name=name, limits=limits, holder=holder, **sizes)


SLOW = _robot(
    "slow",
    Limits(v=0.3, w=1.0, a=0.4, brake=0.4, aw=2.0),
    Limits(v=0.25, w=0.6, a=0.4, brake=0.3, aw=1.5),
    front=0.12, rear=0.12, half_width=0.11, track=0.2, mass=3.0,
)  # fmt: skip
HEAVY = _robot(
    "heavy",
    Limits(v=1.0, w=1.5, a=0.25, brake=0.25, aw=1.0),
    Limits(v=0.8, w=0.8, a=0.25, brake=0.2, aw=0.8),
    front=0.35, rear=0.4, half_width=0.3, track=0.5, mass=40.0, wheel_torque=15.0,
)  # fmt: skip
QUICK = _robot(
    "quick",
    Limits(v=2.5, w=6.0, a=2.0, brake=2.0, aw=12.0),
    Limits(v=2.0, w=2.0, a=1.5, brake=0.6, aw=6.0),
)
FIFTH = _robot(
    "fifth",
    Limits(v=0.8, w=1.8, a=0.6, brake=0.6, aw=2.5),
    Limits(v=0.7, w=1.0, a=0.6, brake=0.4, aw=2.0),
    front=0.16, rear=0.18, half_width=0.16, track=0.28, mass=6.0, motor_time_constant=0.08,
)  # fmt: skip
OTHERS = (SLOW, HEAVY, QUICK, FIFTH)
