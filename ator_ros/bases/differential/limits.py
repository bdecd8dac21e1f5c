"""The limits of a base with two driven wheels."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Annotated

from ator_ros.schema import Within

LEAST = 0.01
GREATEST = {"v": 20.0, "w": 50.0, "a": 100.0, "brake": 100.0, "aw": 1000.0}
"""The bounds of `Limits`: tables of turns take 3 MB for each m/s; beyond are wrong units."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Greatest speeds and accelerations, the same forward and backward unless `v_back` is 0."""

    v: Annotated[float, Within(LEAST, GREATEST["v"])]  # m/s
    w: Annotated[float, Within(LEAST, GREATEST["w"])]  # rad/s
    a: Annotated[float, Within(LEAST, GREATEST["a"])]  # m/s^2; gaining speed
    brake: Annotated[float, Within(LEAST, GREATEST["brake"])]  # m/s^2; losing speed
    aw: Annotated[float, Within(LEAST, GREATEST["aw"])]  # rad/s^2
    v_back: float | None = None  # m/s; greatest speed backward: 0, or None for `v`

    def __post_init__(self) -> None:
        """Replace a `v_back` of `v` by None; raise ValueError if it is neither that nor 0."""
        if self.v_back == self.v:
            object.__setattr__(self, "v_back", None)
        elif self.v_back not in (None, 0.0):
            raise ValueError(
                f"v_back: expected 0, for a base that never drives backward, or v ({self.v:g}), "
                f"got {self.v_back:g}"
            )

    @property
    def backward(self) -> float:
        """Greatest speed backward in m/s: 0 or `v`."""
        return self.v if self.v_back is None else self.v_back

    def scaled(self, factor: float) -> Limits:
        """Return these limits times `factor`."""
        return dataclasses.replace(
            self, **{name: factor * getattr(self, name) for name in GREATEST}
        )

    def within(self, other: Limits) -> Limits:
        """Return the smaller of both limits in each value."""
        least = {name: min(getattr(self, name), getattr(other, name)) for name in GREATEST}
        v_back = 0.0 if 0.0 in (self.v_back, other.v_back) else None
        return Limits(**least, v_back=v_back)


@dataclass(frozen=True, slots=True)
class StopBraking:
    """Deceleration of a base on a command to stop, which exceeds that of `Limits`."""

    # m/s^2; above 4.5 a small base tips
    forward: Annotated[float, Within(LEAST, GREATEST["brake"])] = 4.0
    backward: Annotated[float, Within(LEAST, GREATEST["brake"])] = 5.0  # m/s^2; driving backward
    turning: Annotated[float, Within(LEAST, GREATEST["aw"])] = 12.0  # rad/s^2
