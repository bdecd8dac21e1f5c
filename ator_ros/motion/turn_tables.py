"""Tables of the displacements of turns at the limits while the speed changes, computed once per family."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ator_ros.compiled import compiled
from ator_ros.geometry import FloatArray
from ator_ros.motion.displacements import NODES, WEIGHTS, speeds_after
from ator_ros.motion.durations import turn_parts
from ator_ros.robot.description import Limits

RealArray = NDArray[np.floating[Any]]

STEP = np.pi / 8.0  # rad between the turns among which motions are bracketed
HALF = 12  # turns of up to 270 degrees to either side
FINE = 36  # entries of the tables per step
SPEED_STEP = 0.02  # m/s
WIDTH = 32  # columns of the tables in which all of TURNS are looked up at once: whole vectors
TURNS: FloatArray = STEP * np.arange(-HALF, HALF + 1, dtype=float)
WIDEST = (HALF + 0.99) * STEP  # up to which turns can be looked up
EDGE = (HALF + 1) * FINE  # entries of the tables either side of no turn


class TurnProfile(NamedTuple):
    """How a turn is driven: change of speed in m/s^2, held at the limit, and greatest turn rate in rad/s."""

    change: float
    rate: float


class TurnTables(NamedTuple):
    """Displacements of turns by angles from -292.5 to 292.5 degrees, for some profiles.

    They are given along and across (to the left of) the heading that lies between the turn and the straight
    drive: there the parts of both turns of a motion just add.

    Attributes
    ----------
    along, across : ndarray, shape (rows * angles,)
        In m; a row for each profile and speed.
    brackets : ndarray, shape (rows, WIDTH)
        Across, at TURNS; the rest is padding.
    fractions : ndarray, shape (rows, FINE, columns)
        Across, at turns that are whole steps apart, beginning with any entry; see `window_of`.
    lowest : float
        First speed in m/s.
    speeds : int
        Number of speeds.
    """

    along: FloatArray
    across: FloatArray
    brackets: RealArray
    fractions: RealArray
    lowest: float
    speeds: int


@compiled
def row_of(tables: TurnTables, profile: int, speed: float) -> int:
    """Return the row of turns with a profile that start at `speed` (m/s)."""
    row = int((speed - tables.lowest) * (1.0 / SPEED_STEP) + 0.5)
    return profile * tables.speeds + min(max(row, 0), tables.speeds - 1)


@compiled
def window_of(moved: float) -> tuple[int, int]:
    """Return where in a row of `fractions` TURNS moved by `moved` (rad, within 540 degrees) begin."""
    place = int(2 * HALF * FINE + 0.5 + moved * (FINE / STEP))
    return place % FINE, place // FINE


@compiled
def place_of(row: int, angle: float) -> tuple[int, float]:
    """Return where a turn by `angle` (rad) lies in a table: the entry before, and the share beyond."""
    place = angle * (FINE / STEP) + EDGE
    low = int(place)
    return low + row * (2 * EDGE + 1), place - low


@compiled
def look_up(table: FloatArray, low: int, share: float) -> float:
    """Look up `along` or `across` at a place."""
    result: float = table[low] + share * (table[low + 1] - table[low])
    return result


def turn_tables(limits: Limits, profiles: tuple[TurnProfile, ...]) -> TurnTables:
    """Compute the tables of `profiles` for a robot's limits."""
    angles: FloatArray = np.linspace(0.0, (HALF + 1) * STEP, EDGE + 1)
    speeds: FloatArray = np.arange(-limits.v, limits.v + SPEED_STEP / 2, SPEED_STEP, dtype=np.float64)
    parts = [_displacements(limits, profile, speeds, angles) for profile in profiles]
    # A turn to the right is the mirror image of one to the left.
    along = np.concatenate([np.hstack((x[:, :0:-1], x)) for x, _ in parts])
    across = np.concatenate([np.hstack((-y[:, :0:-1], y)) for _, y in parts])
    # TURNS moved by up to 2 * HALF steps to either side; values beyond the table are discarded later.
    beyond = (2 * HALF - 1) * FINE
    wide = np.pad(across[:, :-1], ((0, 0), (beyond, beyond + 2 * FINE)), mode="edge").astype(np.float32)
    filled = ((0, 0), (0, WIDTH - len(TURNS)))
    fractions = np.pad(wide.reshape(len(wide), -1, FINE).swapaxes(1, 2), ((0, 0), *filled))
    brackets = np.pad(across[:, FINE:-FINE:FINE].astype(np.float32), filled)
    return TurnTables(along.ravel(), across.ravel(), brackets, fractions, -limits.v, len(speeds))


def _displacements(
    limits: Limits, profile: TurnProfile, speeds: FloatArray, angles: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return along and across, shapes (speeds, angles), of turns to the left with one profile."""
    ramp, steady = turn_parts(angles, profile.rate, limits.aw)
    time = 2.0 * ramp + steady
    now, ramp = time[:, None] * NODES, ramp[:, None]
    begin = np.minimum(now, ramp)
    end = np.minimum(time[:, None] - now, ramp)
    even = limits.aw * ramp * np.clip(now - ramp, 0.0, steady[:, None])
    # Ramp up, even rate, ramp down: the last part is what the mirrored ramp still lacks.
    heading = 0.5 * limits.aw * (begin * begin + ramp * ramp - end * end) + even
    weight = WEIGHTS * time[:, None]
    left = angles[:, None] - heading
    cos, sin = weight * np.cos(left), -weight * np.sin(left)
    along, across = (np.empty((len(speeds), len(angles))) for _ in range(2))
    for row, speed in enumerate(speeds):
        driven = speeds_after(speed, profile.change, now, limits.v)
        along[row], across[row] = (driven * cos).sum(axis=1), (driven * sin).sum(axis=1)
    return along, across
