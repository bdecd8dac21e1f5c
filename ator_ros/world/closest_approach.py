"""How near a robot comes to a place that it passes."""

from __future__ import annotations

import math
from dataclasses import dataclass

_AWAY = 0.1  # m farther than it has been, at which a robot leaves a place: above noise


@dataclass
class ClosestApproach:
    """The least distance of a robot from a place.

    Attributes
    ----------
    distance : float
        In m; infinite before the first state.
    """

    distance: float = math.inf

    def leaves(self, distance: float) -> bool:
        """Take a newer distance in m; return whether the robot now leaves the place."""
        self.distance = min(self.distance, distance)
        return distance > self.distance + _AWAY
