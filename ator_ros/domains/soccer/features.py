"""Soccer's own features: what aims a shot."""

from __future__ import annotations

import numpy as np

from ator_ros.geometry import wrap_angles
from ator_ros.performance.derived import hold_angle, hold_bearing, hold_dist
from ator_ros.performance.features import Feature, variables

_TO_MOUTH = variables("x y yaw xg yg")

SHOT = (
    Feature("hold_dist", "m", _TO_MOUTH, hold_dist),
    Feature("hold_angle", "rad", _TO_MOUTH, lambda g: np.abs(g.once(hold_angle))),
    Feature("hold_off_axis", "rad", _TO_MOUTH, lambda g: np.abs(g.once(hold_bearing))),
    Feature("heading_off_axis", "rad", variables("yaw"), lambda g: np.abs(wrap_angles(g.direct["yaw"]))),
)
"""Of a ball that is held and a goal whose heading does not matter, on the field's x axis."""
