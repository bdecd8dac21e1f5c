"""What the drives of an action cover: what they never varied, and situations that would teach most.

Nothing is learned of a turn or a length that no drive had.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from ator_ros.actions.situation import Sampler, Situation
from ator_ros.bases.description import Robot
from ator_ros.experience.table import Episode
from ator_ros.geometry import FloatArray
from ator_ros.performance.features import (
    GENERAL,
    PAPER_3,
    ROUTE_ANGLE_AT,
    ROUTE_ANGLE_TO,
    ROUTE_LENGTH,
    Feature,
    feature_table,
)
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.training import direct_of

# Models of 40 drives that arrived straight err by 1.4 s at random headings; with so many drives to
# random headings besides, by 0.08 s, as of 60 random drives by 0.05 s.
_ENOUGH = 20
_BEGAN = "began turned by more than {:.0f}°: {} drives to random places are enough"
_ENDED = (
    "ended turned by more than {:.0f}°: headings cannot be chosen yet; "
    "{} drives to random headings are enough"
)
_LONG = "was longer than {:.2g} m, or much shorter; {} drives to random places are enough"
_LACKS = {
    "dist": _LONG,
    "route_length": _LONG,
    "angle_to_dest": _BEGAN,
    "angle_to_straight": _BEGAN,
    "route_angle_to": _BEGAN,
    "angle_at_dest": _ENDED,
    "angle_after_straight": _ENDED,
    "route_angle_at": _ENDED,
}
"""What no drive did, by feature; with its greatest value in degrees or m, and drives to add."""
_NEW = 0.5  # m, rad or m/s from the nearest drive, beyond which a situation is new
_DRAWS = 50


def _features(robot: Robot) -> list[Feature]:
    """Return length, turn at departure and at arrival, speed at departure and at arrival."""
    of_route = [ROUTE_LENGTH, ROUTE_ANGLE_TO, ROUTE_ANGLE_AT]
    path = list(PAPER_3) if robot.grid is None else of_route
    return [*path, GENERAL["v"], GENERAL["speedg"]]


def unvaried(model: PerformanceModel) -> list[str]:
    """Return a remark on each feature that the drives of a model hardly varied."""
    errors = model.errors
    if errors is None:
        return []
    remarks = []
    for name in errors.not_varied:
        at = errors.features.index(name)
        most = errors.center[at] + errors.scale[at] * max(point[at] for point in errors.points)
        if model.features[name].unit == "rad":
            most = math.ceil(math.degrees(most))
        lacks = _LACKS.get(name, f"varied {name}: {{1}} random drives are enough")
        remarks.append(f"{model.action}: no drive {lacks.format(most, _ENOUGH)}")
    return remarks


class Coverage:
    """The situations in which an action was executed.

    Parameters
    ----------
    starts : pandas.DataFrame
        First rows of its drives; there may be none.
    robot : Robot
        The robot of the drives.
    """

    def __init__(self, starts: pd.DataFrame, robot: Robot) -> None:
        self._robot = robot
        self._known = self._quantities(starts)

    def distance(self, situation: Situation) -> float:
        """Return how far a situation is from all others, in m, rad or m/s; see `_features`."""
        rows = Episode(situation, 0.0, True, "", math.nan, math.nan).rows(0, situation.objects)
        off = self._known - self._quantities(rows)
        return float(np.sqrt((off * off).sum(axis=1)).min(initial=math.inf))

    def new(self, draw: Callable[[], Situation]) -> Situation:
        """Return the first situation drawn that is unlike all others, else the one farthest off."""
        found = draw()
        farthest = self.distance(found)
        for _ in range(_DRAWS):
            if farthest > _NEW:
                break
            other = draw()
            distance = self.distance(other)
            if distance > farthest:
                found = other
                farthest = distance
        return found

    def _quantities(self, rows: pd.DataFrame) -> FloatArray:
        table = feature_table(direct_of(rows), self._robot, _features(self._robot))
        return table[np.isfinite(table).all(axis=1)]


@dataclass(frozen=True)
class Unlike:
    """Draws situations that are unlike those of earlier drives, by another sampler."""

    sample: Sampler
    coverage: Coverage

    def __call__(self, robot: Robot, rng: np.random.Generator) -> Situation:
        """Draw a situation."""
        return self.coverage.new(lambda: self.sample(robot, rng))
