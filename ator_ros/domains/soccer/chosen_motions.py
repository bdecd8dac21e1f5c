"""The kinds of ideal motions that are chosen for a robot from a fine grid, and kept with its models."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np

from ator_ros.domains.soccer.families import (
    AT_ONCE,
    NO_RUN,
    PushedTurns,
    approach_family,
    dribble_family,
    drive_family,
    pushing_limits,
)
from ator_ros.domains.soccer.planned.holding import ENTRY_RATES, MARGIN, keeps_ball, push
from ator_ros.motion.displacements import TurnDriving
from ator_ros.motion.families import MOST, FreeTurns, Kind, needed_kinds
from ator_ros.performance.features import Kinds
from ator_ros.printable import short
from ator_ros.robot.description import Robot

DRIVE, APPROACH, DRIBBLE = "drive", "approach", "dribble"
"""Names of the families."""

# What to choose from; all numbers are shares of the limits.
_CHANGES = (-1.0, -0.6, -0.25, 0.0, 0.25, 0.6, 1.0)
_RUNS = (0.0, 0.35, 0.8, 1.0)
_LEADS = (0.1, 0.2, 0.35, 0.55, 0.8)
_LEAST = (0.0, 0.25, 0.5, 0.75)
_GAINS, _LOSSES = (0.0, 0.25, 0.5, 0.75, 0.96), (0.0, 0.5, 0.9)
_AFTER = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.75, 0.95)
_BEGINS = [(AT_ONCE, least) for least in _LEAST] + [(lead, 0.0) for lead in _LEADS]
_ENDS = [(NO_RUN, least) for least in _LEAST[1:]] + [(after, 0.0) for after in _AFTER]

_MAY_LACK = ("entry", "after", "rate")
"""Fields of kinds that are kept as null where they are NaN."""
_TYPES = {"backward": bool, "slower": int}
"""Of fields that are no shares of the limits."""
_MOST_DIFFERENT = 10
"""Values of a field: more of them than a grid has cost memory."""
Turns = TypeVar("Turns", FreeTurns, PushedTurns)


@lru_cache(maxsize=4)
def chosen_drives(robot: Robot) -> Kinds:
    """Return the kinds of drives, and of approaches if the robot can hold a ball; it takes a second."""
    places, runs = free_grid((0.0,)), free_grid(_RUNS)
    needed = needed_kinds(drive_family(robot.limits, places), hold=0.0)
    holding = [] if robot.holder is None else needed_kinds(approach_family(robot, runs), hold=robot.hold)
    return {DRIVE: _stored(places, needed), APPROACH: _stored(runs, holding)}


@lru_cache(maxsize=4)
def chosen_dribbles(robot: Robot) -> Kinds:
    """Return the kinds of dribbles; it takes two seconds."""
    grid = pushed_grid(robot)
    return {DRIBBLE: _stored(grid, needed_kinds(dribble_family(robot, grid), hold=robot.hold))}


def free_grid(runs: Iterable[float] = _RUNS) -> list[FreeTurns]:
    """Return all kinds of motion of a robot that holds nothing, with speeds before the run from `runs`."""
    return [FreeTurns(*row) for row in itertools.product(_CHANGES, _CHANGES, (False, True), runs)]


def pushed_grid(robot: Robot) -> list[PushedTurns]:
    """Return all kinds of motion that are planned with the ball, with the fastest turns that do not lose it.

    Of a robot that loses it in every turn they are those that it loses last.
    """
    ways = itertools.product(_BEGINS, _GAINS, _LOSSES, _ENDS)
    rows = [
        PushedTurns(
            entry, gain, loss, after, least_start=start, least_arrival=arrival,
            rate=_first_rate(robot, start if np.isnan(entry) else entry, gain),
        )
        for (entry, start), gain, loss, (after, arrival) in ways
    ]  # fmt: skip
    kinds = dribble_family(robot, rows).kinds
    holding = [row for row, kind in zip(rows, kinds, strict=True) if row.rate and _holds_last(robot, kind)]
    return holding or [row._replace(rate=np.nan) for row in rows]


@lru_cache(maxsize=256)
def _first_rate(robot: Robot, begin: float, gain: float) -> float:
    """Return the greatest planned rate of a first turn that keeps the ball, as a share; 0 where none does."""
    limits = pushing_limits(robot)
    turns = (TurnDriving(begin * limits.v, gain * limits.a, rate * limits.w) for rate in ENTRY_RATES)
    kept = (rate for rate, turn in zip(ENTRY_RATES, turns, strict=True) if keeps_ball(robot, turn, limits.v))
    return next(kept, 0.0)


def _holds_last(robot: Robot, kind: Kind) -> bool:
    """Return whether the ball stays in front in the last turn."""
    end = kind.share * pushing_limits(robot).v
    speed = max(kind.least_arrival, 0.0) if np.isnan(end) else end
    return push(robot, speed, kind.last.rate, -kind.last.change) >= MARGIN


def _stored(grid: Sequence[FreeTurns | PushedTurns], which: Iterable[int]) -> list[list[float | None]]:
    return [[None if np.isnan(number) else number for number in grid[at]] for at in which]


def turns_of(kinds: Kinds, family: str, kind: type[Turns], *, least: int = 1) -> tuple[Turns, ...]:
    """Return the kinds of a family, `least` of them or more.

    Raises
    ------
    ValueError
        There are too few or too many, they are not shares of the limits as expected, or more different ones
        than of a grid: each has tables of its own.
    """
    rows, fields = kinds.get(family), kind._fields
    if not isinstance(rows, Sequence) or isinstance(rows, str) or not least <= len(rows) <= MOST:
        raise ValueError(f"{family}: expected {least} to {MOST} kinds of motion, got {short(rows)}")
    for number, row in enumerate(rows):
        whole = isinstance(row, Sequence) and len(row) == len(fields)
        if not whole or not all(map(_is_value, fields, row)):
            raise ValueError(
                f"{family}.{number}: expected {len(fields)} values from -1 to 1 ({', '.join(fields)}), "
                f"got {short(row)}"
            )
    for field, *values in zip(fields, *rows, strict=True):
        if (count := len(set(values))) > _MOST_DIFFERENT:
            raise ValueError(
                f"{family}: expected at most {_MOST_DIFFERENT} different values of {field}, got {count}"
            )
    return tuple(kind(*_filled(row)) for row in rows)


def _is_value(field: str, value: object) -> bool:
    if value is None:
        return field in _MAY_LACK
    if field in _TYPES:
        return type(value) is _TYPES[field]
    if isinstance(value, bool) or not isinstance(value, int | float) or abs(value) > 1.0:
        return False
    return field != "rate" or value > 0.0


def _filled(row: Iterable[Any]) -> list[Any]:
    return [np.nan if value is None else value for value in row]
