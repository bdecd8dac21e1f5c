"""Small analytic performance models and chains for the tests of refinement and evaluation."""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from ator_ros.actions.base import Goal
from ator_ros.bases.description import load_robot
from ator_ros.domains.soccer.field import BALL
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.geometry import FloatArray, Pose, wrap_angles
from ator_ros.performance.model import Arrival
from ator_ros.refinement.search import Deadline, Pairs, StepCosts
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.world.state import ObjectState, RobotState, World

ROBOT = load_robot()
LIBRARY = SOCCER.library(ROBOT)
NOTHING: frozenset[str] = frozenset()
ANGLE = frozenset({"yaw"})
BOTH = frozenset({"yaw", "speed"})
ALL = frozenset({"x", "y", "yaw", "speed"})


class FakeModel:
    """Predicts `duration` of the direct variables; success decreases with the arrival speed."""

    def __init__(
        self,
        duration: Callable[[Mapping[str, Any]], Any],
        used: frozenset[str],
        spread: float = 0.1,
    ) -> None:
        self._duration = duration
        self.used_variables = used
        self._spread = spread
        self.arrival: Arrival | None = None

    def predict(
        self, direct: Mapping[str, Any], measures: tuple[str, ...] = (), signs: Any = None
    ) -> Any:
        count = max(np.size(values) for values in direct.values())
        duration = np.broadcast_to(np.asarray(self._duration(direct), dtype=float), count)
        failure = np.asarray(direct.get("speedg", 0.0), dtype=float)
        return SimpleNamespace(
            duration=duration,
            spread=np.full(len(duration), self._spread),
            noise=np.zeros(len(duration)),
            success=np.broadcast_to(1.0 - 0.5 * failure, duration.shape),
            accuracy=np.zeros(len(duration)),
            error_of_sum=(0.0, self._spread**2),
        )


def turning_time(direct: Mapping[str, Any]) -> Any:
    """Turn, drive, turn, with a cost of speed differences."""
    dx, dy = direct["xg"] - direct["x"], direct["yg"] - direct["y"]
    bearing = np.arctan2(dy, dx)
    turns = 1.3 * np.abs(wrap_angles(bearing - direct["yaw"])) + np.abs(
        wrap_angles(direct["yawg"] - bearing)
    )
    return (
        np.hypot(dx, dy) + turns + np.square(direct["v"] - 0.4) + np.square(direct["speedg"] - 0.5)
    )


USED = frozenset({"x", "y", "yaw", "v", "xg", "yg", "yawg", "speedg", "hold"})
SHOOT_USED = USED - {"xg", "yg", "yawg", "speedg"}


def models(used: frozenset[str] = USED) -> dict[str, FakeModel]:
    fake = {name: FakeModel(turning_time, used) for name in ("goToPose", "dribbleBall")}
    return fake | {"shoot": FakeModel(turning_time, used & SHOOT_USED)}


def world(
    x: float = -1.0, y: float = 0.0, yaw: float = 0.0, ball: tuple[float, float] = (0.0, 0.0)
) -> World:
    return World(0.0, RobotState(Pose(x, y, yaw)), {BALL: ObjectState(*ball)})


def call(
    top: str, x: float, y: float, yaw: float, opened: frozenset[str] = NOTHING, speed: float = 0.0
) -> TopCall:
    return TopCall(LIBRARY[top], Goal(Pose(x, y, yaw), speed, LIBRARY[top].point), opened)


def two_steps(opened: frozenset[str] = ANGLE, yaw: float = 0.0) -> TopChain:
    """Go to the ball at the origin, dribble it to (-2, 1)."""
    return TopChain(
        (call("goToBall", 0.0, 0.0, yaw, opened), call("dribbleBall", -2.0, 1.0, math.pi))
    )


def three_steps(opened: frozenset[str] = ANGLE) -> TopChain:
    """Go to the ball, dribble it to a shooting position with an open heading, shoot."""
    return TopChain(
        (
            call("goToBall", 0.0, 0.0, 0.0, opened),
            call("dribbleBall", 1.0, 1.5, 0.0, opened),
            call("shoot", 4.0, 0.0, 0.0),
        )
    )


StepCost = Callable[[int, FloatArray, FloatArray], FloatArray]
"""Returns the cost of step i, shape (n,), from its subgoals, shapes (n or 1, k)."""


def pair_by_pair(cost: StepCost) -> StepCosts:
    """Return a function for `search` from a cost of single steps."""

    def costs(steps: Sequence[Pairs]) -> list[FloatArray]:
        found = []
        for index, before, after in steps:
            n, m = len(before), len(after)
            pairs = np.repeat(before[:, 0], m, axis=0), np.tile(after, (n, 1))
            found.append(np.broadcast_to(cost(index, *pairs), n * m).reshape(n, m))
        return found

    return costs


def after(checks: int) -> Deadline:
    """Return a deadline that passes after `checks` checks."""
    numbers = itertools.count()
    return lambda: next(numbers) >= checks
