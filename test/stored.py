"""Synthetic episodes and learning rounds for tests; durations follow a simple law."""

import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ator_ros.actions.base import Goal
from ator_ros.actions.situation import Situation
from ator_ros.bases.description import load_robot
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.experience.store import RecordStore, StoreInfo
from ator_ros.experience.table import Episode
from ator_ros.geometry import Pose
from ator_ros.learning.round import Source, learn
from ator_ros.learning.sets import publish
from ator_ros.world.state import ObjectState, RobotState

ROBOT = load_robot()
INFO = StoreInfo(ROBOT.digest(), SOCCER.name)
BALL = {"ball": ObjectState(0.5, 0.5)}


def episodes(
    count: int,
    *,
    seed: int = 1,
    action: str = "goToPose",
    slower: float = 1.0,
    noise: float = 0.05,
    values: Mapping[str, float] | None = None,
) -> Iterator[Episode]:
    """Yield episodes whose duration grows with distance and turn, `slower` times as long as usual.

    `values` are the goal variables.
    """
    rng = np.random.default_rng(seed)
    for _ in range(count):
        x, y, xg, yg = rng.uniform(-3.0, 3.0, 4)
        yaw, yawg = rng.uniform(-math.pi, math.pi, 2)
        turn = abs(math.remainder(math.atan2(yg - y, xg - x) - yaw, 2.0 * math.pi))
        duration = (
            slower * (0.5 + math.hypot(xg - x, yg - y) + 0.7 * turn) + noise * rng.standard_normal()
        )
        start, goal = (
            RobotState(Pose(x, y, yaw)),
            Goal(Pose(xg, yg, yawg), values=dict(values or {})),
        )
        yield Episode(
            Situation(action, start, BALL, goal),
            max(duration, 0.1),
            True,
            "made up",
            0.01,
            math.nan,
        )


def stored(folder: Path, *streams: Iterator[Episode], most: int = 20_000) -> RecordStore:
    store = RecordStore(folder, INFO, most=most)
    for stream in streams:
        for episode in stream:
            store.append("default", episode)
    return store


def round_of(folder: Path, models: Path = SOCCER.shipped_models) -> dict[str, Any]:
    """Run a learning round and publish its set, if any; return the result."""
    result = learn(Source(folder, SOCCER, ROBOT, models), time="2026-01-01T00:00:00Z")
    if result["made"]:
        publish(folder, Path(result["made"]))
    return result


def losses(reason: str) -> tuple[float, float]:
    """Return the mean losses of the tree in use and of the best candidate, by a verdict."""
    found = re.search(r"from ([\d.e-]+) to ([\d.e-]+)", reason)
    assert found is not None, reason
    return float(found.group(1)), float(found.group(2))
