"""How an action drives an omnidirectional base: the limits that its odometry shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ator_ros.bases.interface import Driving
from ator_ros.bases.omni.omni_limits import GREATEST, LEAST, OmniLimits
from ator_ros.geometry import FloatArray

if TYPE_CHECKING:
    import pandas as pd

_SPEED_QUANTILE = 0.995  # of the speeds along an axis that counts as the greatest
# quantile of the accelerations that counts as the greatest; lower, as their noise is larger
_CHANGE_QUANTILE = 0.95
_MOVES = 0.1  # share of a greatest acceleration above which the velocity changes
_LEAST_SAMPLES = 10  # rows for a quantile
_LEAST_SHARE = 0.05  # of the base's limit; smaller quantiles are noise, not limits


@dataclass(frozen=True)
class OmniDriving(Driving):
    """How an action drives: within these limits."""

    limits: OmniLimits


def observed_limits(rows: pd.DataFrame, limits: OmniLimits) -> OmniLimits:
    """Return the limits that an action drives at.

    Where too little was observed, they are those of the base. The shape is that of the base.

    Parameters
    ----------
    rows : pandas.DataFrame
        Rows of the action in an experience table.
    limits : OmniLimits
        Those of the base.
    """
    vx, vy, w = (rows[name].to_numpy(dtype=float) for name in ("v", "vy", "w"))
    time = rows["t"].to_numpy(dtype=float)
    episode = rows["episode"].to_numpy()
    step = np.diff(time)
    follows = (episode[1:] == episode[:-1]) & (step > 0.0)
    step = np.where(follows, step, np.inf)
    # Accelerations over the floor, in the frame of the robot, which turns.
    middle_vx = 0.5 * (vx[1:] + vx[:-1])
    middle_vy = 0.5 * (vy[1:] + vy[:-1])
    middle_w = 0.5 * (w[1:] + w[:-1])
    ahead = np.where(follows, np.diff(vx) / step - middle_w * middle_vy, 0.0)
    aside = np.where(follows, np.diff(vy) / step + middle_w * middle_vx, 0.0)
    turning = np.diff(w) / step
    gains = ahead * middle_vx > 0.0
    return OmniLimits(
        v=_greatest(vx, _SPEED_QUANTILE, limits.v, "v"),
        v_back=_greatest(-vx, _SPEED_QUANTILE, limits.backward, "v"),
        v_side=_greatest(np.abs(vy), _SPEED_QUANTILE, limits.sideways, "v"),
        w=_greatest(np.abs(w), _SPEED_QUANTILE, limits.w, "w"),
        a=_greatest(np.abs(ahead[gains]), _CHANGE_QUANTILE, limits.a, "a"),
        brake=_greatest(np.abs(ahead[~gains]), _CHANGE_QUANTILE, limits.brake, "a"),
        a_side=_greatest(np.abs(aside), _CHANGE_QUANTILE, limits.side_change, "a"),
        aw=_greatest(np.abs(turning), _CHANGE_QUANTILE, limits.aw, "aw"),
        shape=limits.shape,
    )


def _greatest(values: FloatArray, quantile: float, described: float, kind: str) -> float:
    """Return a quantile of the values above a tenth of the described limit.

    The described limit if (almost) nothing was observed.
    """
    used = values[values > _MOVES * described]
    if len(used) < _LEAST_SAMPLES:
        return described
    found = float(np.quantile(used, quantile))
    if found < _LEAST_SHARE * described:
        return described
    return min(max(found, LEAST), GREATEST[kind])
