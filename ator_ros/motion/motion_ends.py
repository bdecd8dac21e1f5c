"""Parts of ideal motions that depend only on end speeds."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ator_ros.compiled import compiled
from ator_ros.motion.durations import Rates, change_distance, change_time, forward_time
from ator_ros.motion.turn_tables import TurnTables, row_of

KIND = np.dtype(
    [("first_way", np.intp), ("last_way", np.intp)]
    + [(f"{turn}_{what}", float) for what in ("change", "rate") for turn in ("first", "last")]
    + [(name, float) for name in ("share", "entry", "least_start", "least_arrival")]
    + [("direction", np.float32)],
    align=True,
)
"""A kind of motion as a row; see `families.Kind`."""

ENTRY = np.dtype([("speed", float), ("way", float), ("time", float), ("row", np.intp)])
"""The begin of a kind's motions: speed in m/s at the first turn, straight way (m) and time (s) up to there,
and the turn's row in the tables."""

LEAVE = np.dtype([("speed", float), ("way", float), ("time", float), ("row", np.intp)])
"""The same of their end: speed after the last turn, straight way and time from there on."""

Rows = NDArray[np.void]


class Rules(NamedTuple):
    """What holds for all kinds of a family; see `families.Family`.

    run: NaN where it is as long as needed. detour: s per m that a straight drive passes too near the object.
    """

    rates: Rates
    run: float
    passing: float
    detour: float
    forward: bool
    hold: float


@compiled
def set_speed(entries: Rows, speed: float, kinds: Rows, tables: TurnTables, rules: Rules) -> None:
    """Write the begins of all kinds for a speed (m/s) at the start; those that need more take forever."""
    rates = rules.rates
    for index in range(len(kinds)):
        kind, entry = kinds[index], entries[index]
        reached = speed if math.isnan(kind["entry"]) else kind["entry"]
        entry["speed"], entry["way"] = reached, change_distance(speed, reached, rates)
        entry["time"] = change_time(speed, reached, rates) if speed >= kind["least_start"] else np.inf
        entry["row"] = row_of(tables, kind["first_way"], reached)


@compiled
def set_arrival(leaves: Rows, arrival: float, kinds: Rows, tables: TurnTables, rules: Rules) -> None:
    """Write the ends of all kinds for a speed (m/s) at the destination, as `set_speed` does."""
    for index in range(len(kinds)):
        kind, leave = kinds[index], leaves[index]
        speed, run = _before_run(kind["share"], arrival, rules)
        leave["speed"], leave["way"] = speed, run
        time = forward_time(run, speed, arrival, rules.rates)
        leave["time"] = time if arrival >= kind["least_arrival"] else np.inf
        leave["row"] = row_of(tables, kind["last_way"], speed)


@compiled
def _before_run(share: float, arrival: float, rules: Rules) -> tuple[float, float]:
    """Return speed (m/s) and distance (m) to the goal where the straight run begins."""
    rates, square = rules.rates, arrival * arrival
    if math.isnan(share):
        return arrival, 0.0
    if math.isnan(rules.run):
        speed = share * rates.v
        change = speed * speed - square
        return speed, max(change * (0.5 / rates.brake), change * (-0.5 / rates.a))
    greatest = min(math.sqrt(square + 2.0 * rates.brake * rules.run), rates.v)
    least = math.sqrt(max(square - 2.0 * rates.a * rules.run, 0.0))
    return least + share * (greatest - least), rules.run
