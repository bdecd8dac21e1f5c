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
from ator_ros.bases.direct import NEAR_GOAL
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
from ator_ros.performance.training import direct_of

# Models of 40 drives that arrived straight err by 1.4 s at random headings; with so many drives to
# random headings besides, by 0.08 s, as of 60 random drives by 0.05 s.
_ENOUGH = 20
_TURNED = math.radians(10.0)  # beyond which a drive is turned
_LEAST_TURNED = 3  # drives that are turned, and their least share
_LEAST_SHARE = 0.05
_LEAST_RATIO = 1.5  # of the lengths of long and short drives
_NEW = 0.5  # m, rad or m/s from the nearest drive, beyond which a situation is new
_DRAWS = 50


def _features(robot: Robot) -> list[Feature]:
    """Return length, turn at departure and at arrival, speed at departure and at arrival."""
    of_route = [ROUTE_LENGTH, ROUTE_ANGLE_TO, ROUTE_ANGLE_AT]
    path = list(PAPER_3) if robot.grid is None else of_route
    return [*path, GENERAL["v"], GENERAL["speedg"]]


def unvaried(action: str, starts: pd.DataFrame, robot: Robot) -> list[str]:
    """Return a remark on each quantity that drives never varied, with what is missing.

    Parameters
    ----------
    action : str
        Name of the action.
    starts : pandas.DataFrame
        First rows of its drives that succeeded, see `ator_ros.experience.table`.
    robot : Robot
        The robot of the drives.
    """
    table = feature_table(direct_of(starts), robot, _features(robot))
    drives = table[np.isfinite(table).all(axis=1) & (table[:, 0] > NEAR_GOAL)]
    if not len(drives):
        return []
    length, departure, arrival, *_ = drives.T
    random = f"{_ENOUGH} drives to random"
    remarks = [
        f"{_turned(departure, 'began')}: {random} places are enough",
        f"{_turned(arrival, 'ended')}: headings cannot be chosen yet; {random} headings are enough",
    ]
    short, long = np.quantile(length, (0.05, 0.95))
    if long < _LEAST_RATIO * short:
        remarks.append(
            f"drives were {length.min():.2g} to {length.max():.2g} m long: others cannot be "
            f"compared yet; {random} places are enough"
        )
    return [f"{action}: {remark}" for remark in remarks if not remark.startswith(":")]


def _turned(angles: FloatArray, end: str) -> str:
    """Return that hardly any drive began or ended turned by some angle (rad); empty if many did."""
    turned = int((angles > _TURNED).sum())
    if turned >= max(_LEAST_TURNED, _LEAST_SHARE * len(angles)):
        return ""
    most = math.ceil(math.degrees(_TURNED if turned else angles.max()))
    which = f"only {turned} of {len(angles)} drives" if turned else "no drive"
    return f"{which} {end} turned by more than {most}°"


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
