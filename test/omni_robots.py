"""Omnidirectional robots for tests: those that ship, and one with a holder in a soccer scene."""

import dataclasses

from ator_ros.bases.description import load_robot
from ator_ros.bases.omni.omni_limits import OmniLimits
from ator_ros.bases.omni.omni_robot import OmniHolder, OmniRobot, omnidirectional
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.resources import resource_path

NAMES = ("omni_soccer", "mecanum")
FILES = tuple(resource_path("config", f"{name}.yaml") for name in NAMES)
ROBOTS: tuple[OmniRobot, ...] = tuple(omnidirectional(load_robot(file)) for file in FILES)
ALIKE, UNLIKE = ROBOTS
"""Alike in all directions; faster ahead than aside."""
_SOCCER = SOCCER.robot()
_FINGERS = _SOCCER.holder_for("a test")
WITH_HOLDER = dataclasses.replace(
    ALIKE,
    name="with_holder",
    scene=_SOCCER.scene,
    holder=OmniHolder(
        length=_FINGERS.length,
        gap=_FINGERS.gap,
        thickness=_FINGERS.thickness,
        radius=_FINGERS.radius,
        limits=OmniLimits(v=1.0, w=1.0, a=0.5, brake=0.5, aw=2.0),
    ),
)
