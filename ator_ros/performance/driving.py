"""How an action was observed to drive, as far as the times of its paths depend on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Annotated, Any

from ator_ros.robot.description import Limits, Robot
from ator_ros.schema import Within, require, structured

LEVELS = 10
"""Ranges of speed, of equal width up to the greatest, for which turn rates are kept."""
_FULL = (1.0,) * LEVELS


@dataclass(frozen=True)
class DrivingStyle:
    """How an action drives, as far as odometry and durations show it.

    Attributes
    ----------
    limits : Limits
        Greatest speeds and accelerations.
    backward : bool
        Whether it drives backward.
    run : float or None
        Length in m of the straight run up to the object held at the goal; None where the run is as long as
        its change of speed needs.
    passing : float
        Distance in m that a straight drive keeps from the object held at the goal.
    steady, braking : tuple of float, LEVELS of them
        Greatest turn rate at each range of speeds as a share of `limits.w`: at a steady speed, and while
        losing speed.
    """

    limits: Limits
    backward: bool = True
    run: float | None = 0.0
    passing: float = 0.0
    steady: tuple[float, ...] = _FULL
    braking: tuple[float, ...] = _FULL

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> DrivingStyle:
        """Return the style whose fields are in `data`, as `dataclasses.asdict` gives them to a JSON file.

        Raises
        ------
        SchemaError
            The data are not of this form.
        """
        read = structured(data, _Seen, closed=True)
        limits = Limits(**asdict(read.limits))
        return DrivingStyle(limits, read.backward, read.run, read.passing, read.steady, read.braking)


def plain_driving(robot: Robot) -> DrivingStyle:
    """Return the assumption for an action that was not observed: all that the base can do."""
    return DrivingStyle(robot.limits)


@dataclass(frozen=True)
class _SeenLimits:
    """As in `Limits`; what was seen of an action may lie beyond what a robot's description may say."""

    v: float
    w: float
    a: float
    brake: float
    aw: float

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name, value in asdict(self).items():
            require(0.0 < value < 1000.0, name, "a number above 0 and below 1000", value)


@dataclass(frozen=True)
class _Seen:
    """A `DrivingStyle` in a file."""

    limits: _SeenLimits
    backward: bool
    run: Annotated[float, Within(0.0)] | None
    passing: Annotated[float, Within(0.0)]
    steady: tuple[Annotated[float, Within(0.0, 1.0)], ...]
    braking: tuple[Annotated[float, Within(0.0, 1.0)], ...]

    def __post_init__(self) -> None:
        """Check the number of turn rates."""
        for name in ("steady", "braking"):
            require(
                len(getattr(self, name)) == LEVELS, name, f"{LEVELS} turn rates", len(getattr(self, name))
            )
