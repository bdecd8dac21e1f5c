"""Robots other than the Pioneer, for tests of values derived from a description."""

import dataclasses
from pathlib import Path
from typing import Any

import yaml

from ator_ros.bases.description import Robot, load_robot
from ator_ros.bases.differential.limits import Limits
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.resources import resource_path

PIONEER = SOCCER.robot()
SHIPPED = tuple(
    resource_path("config", f"{name}.yaml") for name in ("turtlebot4", "pioneer_lx", "patrolbot")
)
PLAIN, HEAVY, QUICK = map(load_robot, SHIPPED)
"""Without a holder; with weak acceleration; quick."""
FIFTH = load_robot(Path(__file__).with_name("fifth.yaml"))
SLOW = dataclasses.replace(
    PLAIN,
    name="slow",
    holder=dataclasses.replace(
        PIONEER.holder_for("a test"), limits=Limits(v=0.4, w=0.6, a=0.4, brake=0.3, aw=1.5)
    ),
)
OTHERS = (SLOW, HEAVY, QUICK, FIFTH)


def loaded(data: dict[str, Any], folder: Path) -> Robot:
    file = folder / "own.yaml"
    file.write_text(yaml.safe_dump(data), encoding="utf-8")
    return load_robot(file)
