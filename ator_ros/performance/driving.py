"""How an action was seen to drive: what the times of paths need to know of it, and nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from ator_ros.robot.description import Limits, Robot

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
        Length in m of the straight run up to what is held at the goal; None where the run is as long as
        its change of speed needs.
    passing : float
        Distance in m that a straight drive keeps from what is held at the goal.
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

    def to_dict(self) -> dict[str, Any]:
        """Return plain data, from which `from_dict` makes the same again."""
        return asdict(self)

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> DrivingStyle:
        """Return what `to_dict` turned into data.

        Raises
        ------
        ValueError
            The data are not of this form.
        """
        try:
            limits = Limits(**{name: _positive(value) for name, value in data["limits"].items()})
            run = data["run"]
            steady, braking = (tuple(map(float, data[name])) for name in ("steady", "braking"))
            read = DrivingStyle(
                limits,
                bool(data["backward"]),
                None if run is None else abs(float(run)),
                abs(float(data["passing"])),
                steady,
                braking,
            )
        except (KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"expected how an action drives, got {str(error)[:80]}") from error
        if len(steady) != LEVELS or len(braking) != LEVELS:
            raise ValueError(f"expected {LEVELS} turn rates, got {len(steady)} and {len(braking)}")
        return read


def plain_driving(robot: Robot) -> DrivingStyle:
    """Return the assumption for an action that was not observed: all that the base can do."""
    return DrivingStyle(robot.limits)


def _positive(value: Any) -> float:
    number = float(value)
    if not 0.0 < number < 1000.0:
        raise ValueError(f"expected limits above 0 and below 1000, got {number:g}")
    return number
