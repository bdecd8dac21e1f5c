"""How an action was observed to drive, as far as the times of its paths depend on it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Annotated

from ator_ros.robot.description import Limits, Robot
from ator_ros.schema import Within, require

LEVELS = 10
"""Ranges of speed, of equal width up to the greatest, for which turn rates are kept."""
_FULL = (1.0,) * LEVELS
_Observed = Annotated[float, Within(1e-6, 1000.0)]
_Share = Annotated[float, Within(0.0, 1.0)]


@dataclass(frozen=True, slots=True)
class ObservedLimits(Limits):
    """Limits that odometry showed: they may lie beyond what a robot's description may say."""

    v: _Observed
    w: _Observed
    a: _Observed
    brake: _Observed
    aw: _Observed


@dataclass(frozen=True)
class DrivingStyle:
    """How an action drives, as far as odometry and durations show it.

    Attributes
    ----------
    run : float or None
        Length in m of the straight run up to the object held at the goal; None where the run is as long as
        its change of speed needs.
    passing : float
        Distance in m that a straight drive keeps from the object held at the goal.
    steady, braking : tuple of float, LEVELS of them
        Greatest turn rate at each range of speeds as a share of `limits.w`: at a steady speed, and while
        losing speed.
    """

    limits: ObservedLimits
    backward: bool = True
    run: Annotated[float, Within(0.0)] | None = 0.0
    passing: Annotated[float, Within(0.0)] = 0.0
    steady: tuple[_Share, ...] = _FULL
    braking: tuple[_Share, ...] = _FULL

    def __post_init__(self) -> None:
        """Check the number of turn rates."""
        for name in ("steady", "braking"):
            count = len(getattr(self, name))
            require(count == LEVELS, name, f"{LEVELS} turn rates", count)


def plain_driving(robot: Robot) -> DrivingStyle:
    """Return the assumption for an action that was not observed: all that the base can do."""
    return DrivingStyle(ObservedLimits(**asdict(robot.limits)))
