"""The limits of a base that moves in any direction, whatever its heading."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

from ator_ros.compiled import compiled
from ator_ros.schema import Within

LEAST = 0.01
GREATEST = {"v": 20.0, "w": 50.0, "a": 100.0, "aw": 1000.0}
"""The bounds of limits in m/s, rad/s, m/s^2, rad/s^2: beyond are wrong units."""

Speed = Annotated[float, Within(LEAST, GREATEST["v"])]
Acceleration = Annotated[float, Within(LEAST, GREATEST["a"])]
_SAME_AS = {"v_back": "v", "v_side": "v", "a_side": "a"}
_SCALED = ("v", "w", "a", "brake", "aw", *_SAME_AS)


class PlanarRates(NamedTuple):
    """`OmniLimits` as plain numbers for compiled code; `box` is whether the shape is a box."""

    v: float
    v_back: float
    v_side: float
    w: float
    a: float
    brake: float
    a_side: float
    aw: float
    box: bool


@dataclass(frozen=True, slots=True)
class OmniLimits:
    """Greatest velocities and accelerations over the floor, along the axes of the robot.

    `shape` is that of the set of all velocities, and of all accelerations: an ellipse with these
    half axes, or the box around it. A turn of the robot while it drives is no acceleration.
    """

    v: Speed  # m/s; forward
    w: Annotated[float, Within(LEAST, GREATEST["w"])]  # rad/s
    a: Acceleration  # m/s^2; gaining speed forward or backward
    brake: Acceleration  # m/s^2; losing speed forward or backward
    aw: Annotated[float, Within(LEAST, GREATEST["aw"])]  # rad/s^2
    v_back: Speed | None = None  # m/s; backward. None: v
    v_side: Speed | None = None  # m/s; to both sides. None: v
    a_side: Acceleration | None = None  # m/s^2; gaining and losing speed sideways. None: a
    shape: Literal["ellipse", "box"] = "ellipse"

    def __post_init__(self) -> None:
        """Replace values that are the default by None, so that equal limits are equal."""
        for name, other in _SAME_AS.items():
            if getattr(self, name) == getattr(self, other):
                object.__setattr__(self, name, None)

    @property
    def backward(self) -> float:
        """Greatest speed backward in m/s."""
        return self.v if self.v_back is None else self.v_back

    @property
    def sideways(self) -> float:
        """Greatest speed to the side in m/s."""
        return self.v if self.v_side is None else self.v_side

    @property
    def side_change(self) -> float:
        """Greatest acceleration to the side in m/s^2."""
        return self.a if self.a_side is None else self.a_side

    @property
    def least_change(self) -> float:
        """Least of the accelerations in m/s^2: what the base does in any direction."""
        return min(self.a, self.brake, self.side_change)

    @property
    def rates(self) -> PlanarRates:
        """The limits as plain numbers."""
        return PlanarRates(
            v=float(self.v),
            v_back=float(self.backward),
            v_side=float(self.sideways),
            w=float(self.w),
            a=float(self.a),
            brake=float(self.brake),
            a_side=float(self.side_change),
            aw=float(self.aw),
            box=self.shape == "box",
        )

    def scaled(self, factor: float) -> OmniLimits:
        """Return these limits times `factor`."""
        values = {name: getattr(self, name) for name in _SCALED}
        scaled = {name: factor * value for name, value in values.items() if value is not None}
        return dataclasses.replace(self, **scaled)

    def speed_towards(self, angle: float) -> float:
        """Return the greatest speed in m/s in a direction, in rad from the heading."""
        return extent(self.v, self.backward, self.sideways, angle, self.shape == "box")


@compiled
def extent(front: float, back: float, side: float, angle: float, box: bool) -> float:
    """Return how far a set with these half axes extends at an angle in rad from its front."""
    cos = math.cos(angle)
    ahead = abs(cos) / (front if cos >= 0.0 else back)
    aside = abs(math.sin(angle)) / side
    if box:
        return 1.0 / max(ahead, aside)
    return 1.0 / math.sqrt(ahead * ahead + aside * aside)


@compiled
def least_extent(
    front: float, back: float, side: float, angle: float, turned: float, box: bool
) -> float:
    """Return the least `extent` in a direction while the set turns by `turned` rad.

    `angle` is that of the direction from its front before, in rad.
    """
    quarter = 0.5 * math.pi
    low = min(angle, angle - turned)
    high = max(angle, angle - turned)
    least = min(extent(front, back, side, low, box), extent(front, back, side, high, box))
    # Within each quarter the extent has no minimum: it is at an axis, or at an end.
    for number in range(math.ceil(low / quarter), math.floor(high / quarter) + 1):
        axis = number % 4
        if axis == 0:
            least = min(least, front)
        elif axis == 2:
            least = min(least, back)
        else:
            least = min(least, side)
    return least
