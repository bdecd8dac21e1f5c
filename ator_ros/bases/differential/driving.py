"""How an action drives, as far as the times of its paths depend on it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from types import MappingProxyType
from typing import Annotated, ClassVar

import numpy as np

from ator_ros.bases.differential.durations import rates_of
from ator_ros.bases.differential.limits import Limits
from ator_ros.bases.differential.shapes import (
    Rules,
    Shape,
    ShapeSet,
    drawn_ends,
    needed_shapes,
    shape_set,
)
from ator_ros.bases.interface import Driving
from ator_ros.geometry import FloatArray
from ator_ros.schema import Within, require

_NUMBERS = len(Shape._fields)

StoredShape = tuple[float | None, ...]
"""A `Shape` in a file; None where a number does not apply."""
StoredGroups = tuple[tuple[StoredShape, ...], ...]
"""Groups of shapes, see `ator_ros.bases.differential.shapes.ShapeSet`."""


@dataclass(frozen=True)
class DrivingStyle(Driving):
    """How an action drives, as far as odometry and durations show it.

    Attributes
    ----------
    limits : Limits
        Greatest speeds and accelerations of the action, in SI units.
    drives, approaches : tuple
        Groups of shapes of paths, the fastest of which counts: to a pose, and to a pose at which
        the robot holds an object. Without approaches, the drives hold for both.
    forward : bool
        Whether it never drives backward.
    free_heading : bool
        Whether it ends at any heading, as a shot does: its paths have no last turn.
    run : float
        Length in m of the straight run up to the object held at the goal. If the action only drives
        forward, the run is as long as its change of speed needs.
    passing : float
        Distance in m that a straight drive keeps from the object held at the goal.
    backward_above : float
        Angle in rad to the destination above which it drives backward; pi if it never does, if no
        angle separates such drives from the others, or if the distances driven are unknown.

    Raises
    ------
    SchemaError
        There are no shapes, or one has another number of fields than `Shape`.
    """

    quantities: ClassVar[Mapping[str, str]] = MappingProxyType(
        {
            "angle_to_straight": "rad",
            "angle_after_straight": "rad",
            "backward": "",
            "dist_backward": "m",
        }
    )
    """Of a straight that is driven backward if the angle to the destination is large.

    The turns before and after the straight, whether it is driven backward, and its length then.
    """

    limits: Limits
    drives: StoredGroups
    approaches: StoredGroups = ()
    forward: bool = False
    free_heading: bool = False
    run: Annotated[float, Within(0.0)] = 0.0
    passing: Annotated[float, Within(0.0)] = 0.0
    backward_above: Annotated[float, Within(0.0, math.pi)] = math.pi

    def __post_init__(self) -> None:
        """Check the shapes."""
        complete = bool(self.drives) and all((*self.drives, *self.approaches))
        require(complete, "drives", "shapes of paths", 0)
        for shape in itertools.chain(*self.drives, *self.approaches):
            expected = f"shapes of {_NUMBERS} numbers"
            require(len(shape) == _NUMBERS, "drives, approaches", expected, len(shape))

    @property
    def uses_quantities(self) -> bool:
        """Whether some straights are driven backward."""
        return self.backward_above < math.pi

    def values(self, dist: FloatArray, to: FloatArray, at: FloatArray) -> FloatArray:
        """See `Driving.values`."""
        backward = to > self.backward_above
        to_straight = np.where(backward, np.pi - to, to)
        after_straight = np.where(backward, np.pi - at, at)
        return np.stack([to_straight, after_straight, backward, backward * dist])

    def rule(self) -> str:
        """Return when straights are backward."""
        above = math.degrees(self.backward_above)
        return f"straights are backward if angle_to_dest > {above:.3g}°"

    @cached_property
    def drive_paths(self) -> ShapeSet:
        """The paths to a pose."""
        run = math.nan if self.forward else 0.0
        rules = Rules(
            rates_of(self.limits),
            run,
            forward=self.forward,
            free_heading=self.free_heading,
        )
        return shape_set(_restored(self.drives), rules)

    @cached_property
    def approach_paths(self) -> ShapeSet:
        """The paths to a pose at which the robot holds an object."""
        if not self.approaches:
            return self.drive_paths
        run = math.nan if self.forward else self.run
        rules = Rules(rates_of(self.limits), run, self.passing, self.forward)
        return shape_set(_restored(self.approaches), rules)


def _restored(groups: StoredGroups) -> list[list[Shape]]:
    return [[_restored_shape(numbers) for numbers in group] for group in groups]


def _restored_shape(numbers: StoredShape) -> Shape:
    return Shape(*(math.nan if number is None else number for number in numbers))


def _stored_shape(shape: Shape) -> StoredShape:
    return tuple(None if math.isnan(number) else number for number in shape)


# The grid of candidate shapes. All numbers are shares of the limits.
_CHANGES = (-1.0, -0.6, -0.25, 0.0, 0.25, 0.6, 1.0)  # changes of speed in a turn
# speeds at which a run of given length begins, from the least to the greatest
RUNS = (0.0, 0.35, 0.8, 1.0)
# changes of speed in turns of actions that only drive forward
_GAINS = _LOSSES = (0.0, 0.25, 0.5, 0.75, 1.0)
# losses of speed in the first turn, and least speeds at which it may begin
_SLOWING = ((-0.25, 0.1), (-0.6, 0.3), (-1.0, 0.5))
_LEADS = (0.05, 0.1, 0.15, 0.2, 0.35, 0.55, 0.8, 1.0)  # speeds to reach before the first turn
# speeds at which the last turn may begin
_ARRIVALS = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.6, 0.75, 0.95, 1.0)
# speeds at start or goal that decide how fast the robot may turn there
_LEAST = (0.0, 0.25, 0.5, 0.75)
_SLOWEST = 0.1  # share of the turn rate below which no turn is tried
_DRAWN = 2000  # pairs of ends on which shapes are compared
_SEED = 5  # of these pairs
_PLAIN = 50  # pairs of ends assumed for an action that was not observed

TurnRates = Callable[[float, float], float]
"""Returns the greatest turn rate at a speed and a change of speed.

All are shares of the limits. 0 means no turn.
"""


def free_shapes(limits: Limits, runs: Iterable[float] = (0.0,)) -> list[Shape]:
    """Return the candidate shapes of a base that turns at its limit at any speed.

    The base drives forward and backward. `runs` are speeds at which a run begins, as shares of the
    limit, see `RUNS`.
    """
    return [
        Shape(
            first * limits.a,
            limits.w,
            last * limits.a,
            limits.w,
            share,
            direction=direction,
        )
        for first, last, direction, share in itertools.product(
            _CHANGES,
            _CHANGES,
            (1.0, -1.0),
            runs,
        )
    ]


def plain_forward_shapes(limits: Limits) -> list[Shape]:
    """Return the candidate shapes of forward paths of a base that turns at its limit always."""
    begins = (*((gain, math.nan) for gain in _GAINS), *_SLOWING)
    return [
        Shape(
            first * limits.a,
            limits.w,
            last * limits.a,
            limits.w,
            share=math.nan,
            least_start=least * limits.v,
        )
        for first, least in begins
        for last in _LOSSES
    ]


def forward_shapes(
    limits: Limits,
    first_rate: TurnRates,
    last_rate: TurnRates,
    *,
    free_heading: bool = False,
) -> list[Shape]:
    """Return the candidate shapes of forward paths.

    Parameters
    ----------
    limits : Limits
        Limits of the action.
    first_rate, last_rate : callable
        Greatest rates of the first and of the last turn.
    free_heading : bool
        Whether the action ends at any heading, so that there is no last turn.

    Returns
    -------
    list of Shape
        Empty if no turn is faster than a tenth of the limit.
    """
    at_least = [(least, math.nan, least * limits.v if least else math.nan) for least in _LEAST]
    begins = [
        (
            gain * limits.a,
            first_rate(speed, gain) * limits.w,
            entry * limits.v,
            start,
        )
        for speed, entry, start in (
            *at_least,
            *((lead, lead, math.nan) for lead in _LEADS),
        )
        for gain in _GAINS
    ]
    ends = [
        (loss * limits.brake, last_rate(speed, -loss) * limits.w, share, arrival)
        for speed, share, arrival in (
            *((speed, speed, math.nan) for speed in _ARRIVALS),
            *at_least,
        )
        for loss in _LOSSES
    ]
    ends = [(0.0, limits.w, math.nan, math.nan)] if free_heading else ends
    slowest = _SLOWEST * limits.w
    return [
        Shape(
            gain,
            rate,
            loss,
            other,
            share,
            entry,
            start,
            arrival,
        )
        for gain, rate, entry, start in begins
        for loss, other, share, arrival in ends
        if min(rate, other) > slowest
    ]


def chosen_shapes(
    shapes: Sequence[Shape],
    rules: Rules,
    ends: FloatArray,
    *,
    hold: float,
) -> StoredGroups:
    """Return the groups of `shapes` that are needed: their paths are about as fast as those of all.

    Parameters
    ----------
    shapes : sequence of Shape
        Candidates.
    rules : Rules
        Rules of the paths.
    ends : array of float, shape (5, n)
        Times are compared between ends like these, see `shapes.drawn_ends`.
    hold : float
        Distance in m from the axle to the object in front.

    Returns
    -------
    tuple
        Groups of shapes as a model file stores them.
    """
    drawn = drawn_ends(ends, _DRAWN, np.random.default_rng(_SEED))
    grid = shape_set([[shape] for shape in shapes], rules)
    groups = needed_shapes(grid, drawn, hold=hold)
    return tuple(tuple(_stored_shape(shapes[number]) for number in group) for group in groups)


@lru_cache(maxsize=8)
def plain_driving(limits: Limits) -> DrivingStyle:
    """Return how an action that was not observed is assumed to drive: at all limits of the base."""
    speeds = np.linspace(0.0, limits.v, _PLAIN) * (np.arange(_PLAIN) % 2)
    unturned = np.zeros(_PLAIN)
    distances = np.linspace(0.1, 5.0, _PLAIN)  # m
    arrival_speeds = np.roll(speeds, _PLAIN // 2)
    ends = np.stack((distances, unturned, unturned, speeds, arrival_speeds))
    forward = not limits.backward
    shapes = plain_forward_shapes(limits) if forward else free_shapes(limits)
    rules = Rules(rates_of(limits), math.nan if forward else 0.0, forward=forward)
    return DrivingStyle(
        limits,
        chosen_shapes(shapes, rules, ends, hold=0.0),
        forward=forward,
    )
