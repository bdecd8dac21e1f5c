"""Paths on a grid after Nav2's NavFn: inflated costs, a navigation function, gradient descent.

Source: nav2_navfn_planner and the inflation layer of nav2_costmap_2d; K. Konolige, A gradient
method for realtime robot control, IROS 2000. NavFn expands a wavefront; here the potential is swept
until it is final. Apart from the compiler this is independent of ator_ros, and of ROS.
"""

from __future__ import annotations

import math
from collections import OrderedDict

import numpy as np
from numpy.typing import NDArray

from ator_ros.compiled import compiled

# NavFn: the cost of a cell is 50 + 0.8 times that in the costmap
_COST_NEUTRAL = 50.0
_COST_FACTOR = 0.8
_INSCRIBED = 252.0  # cost in the costmap at the distance of the robot's radius
# Parameters of the inflation layer, fitted to 106 plans of Nav2.
_COST_SCALING_FACTOR = 5.0  # 1/m
_INFLATION_RADIUS = 0.62  # m
_PATH_STEP = 0.5  # cells between the points of a path
_SETTLED = 0.01  # change of a potential below which it is final
_MOST_CACHED = 50  # potentials
_SWEEPS = ((1, 1), (1, -1), (-1, -1), (-1, 1))
Grid = NDArray[np.float64]


class NavFn:
    """Plan shortest paths that keep away from walls, on one map.

    Parameters
    ----------
    free : ndarray of bool, shape (rows, columns)
        Whether cells are free; the first row is at the origin.
    resolution : float
        Side of a cell in m.
    origin : tuple of float
        x, y (m) and yaw (rad) of the outer corner of the first cell.
    radius : float
        Of the robot in m; cells up to so far from a wall or the edge of the map are blocked.
    """

    def __init__(
        self,
        free: NDArray[np.bool_],
        resolution: float,
        origin: tuple[float, float, float],
        radius: float,
    ) -> None:
        from scipy import ndimage

        self._resolution = resolution
        self._origin = origin
        away = resolution * ndimage.distance_transform_edt(np.pad(free, 1))[1:-1, 1:-1]
        inflated = _INSCRIBED * np.exp(-_COST_SCALING_FACTOR * (away - radius))
        self._cost = _COST_NEUTRAL + _COST_FACTOR * np.where(
            away < _INFLATION_RADIUS, inflated, 0.0
        )
        self._cost[away <= radius] = math.inf
        self._potentials: OrderedDict[tuple[int, int], Grid] = OrderedDict()  # of the last goals
        _descend(_potential(np.ones((2, 2)), 0, 0), 1 + 1j, 0j)  # loads compiled code

    def __str__(self) -> str:
        """Return the name of the planner."""
        return "NavFn"

    def __call__(
        self,
        start: tuple[float, float],
        goal: tuple[float, float],
    ) -> Grid | None:
        """Return a path from `start` to `goal`, both x, y in m.

        Returns
        -------
        ndarray, shape (n, 2), or None
            Points in m, half a cell apart, the last one at the goal; None if there is no path.
        """
        here = self._cell(*start)
        there = self._cell(*goal)
        target = round(there.imag), round(there.real)
        rows, columns = self._cost.shape
        on_map = 0 <= target[0] < rows and 0 <= target[1] < columns
        if not on_map or not math.isfinite(self._cost[target]):
            return None
        if target not in self._potentials:
            self._potentials[target] = _potential(self._cost, *target)
            if len(self._potentials) > _MOST_CACHED:
                self._potentials.popitem(last=False)
        self._potentials.move_to_end(target)
        cells = _descend(self._potentials[target], here, there)
        if not len(cells):
            return None
        x, y, yaw = self._origin
        places = x + 1j * y + self._resolution * (cells + (0.5 + 0.5j)) * np.exp(1j * yaw)
        return np.stack([places.real, places.imag], axis=1)

    def _cell(
        self,
        x: float,
        y: float,
    ) -> complex:
        """Return (x, y) m in cells: column + row i, whole numbers in the middle of a cell."""
        x0, y0, yaw = self._origin
        turned = complex(x - x0, y - y0) * complex(math.cos(yaw), -math.sin(yaw))
        return turned / self._resolution - (0.5 + 0.5j)


@compiled
def _at(
    potential: Grid,
    row: int,
    column: int,
) -> float:
    """Return the potential of a cell; infinite outside the map."""
    rows, columns = potential.shape
    on_map = 0 <= row < rows and 0 <= column < columns
    return potential[row, column] if on_map else math.inf


@compiled
def _potential(
    cost: Grid,
    row: int,
    column: int,
) -> Grid:
    """Return the cost of the path from each cell to the goal's cell; infinite without a path.

    The update is NavFn's quadratic approximation of a wave that arrives between two neighbors of a
    cell.
    """
    rows, columns = cost.shape
    potential = np.full((rows, columns), math.inf)
    potential[row, column] = 0.0
    changed = True
    while changed:
        changed = False
        for down, right in _SWEEPS:
            for i in range(rows):
                r = i if down > 0 else rows - 1 - i
                for j in range(columns):
                    c = j if right > 0 else columns - 1 - j
                    own = cost[r, c]
                    if own == math.inf:
                        continue
                    across = min(_at(potential, r - 1, c), _at(potential, r + 1, c))
                    along = min(_at(potential, r, c - 1), _at(potential, r, c + 1))
                    least = min(across, along)
                    if least == math.inf:
                        continue
                    arrival = least + _step(own, abs(across - along))
                    if arrival < potential[r, c] - _SETTLED:
                        potential[r, c] = arrival
                        changed = True
    return potential


@compiled
def _step(own: float, apart: float) -> float:
    """Return the cost of a step into a cell of cost `own`; `apart` is between its neighbors."""
    share = apart / own
    if share >= 1.0:
        return own
    return own * (-0.2301 * share**2 + 0.5307 * share + 0.7040)


@compiled
def _slope(
    potential: Grid,
    row: int,
    column: int,
) -> complex:
    """Return the unit vector (column + row i) in which the potential of a cell falls.

    0 where it is flat.
    """
    own = _at(potential, row, column)
    if own == math.inf:
        return 0j
    left = _at(potential, row, column - 1)
    right = _at(potential, row, column + 1)
    below = _at(potential, row - 1, column)
    above = _at(potential, row + 1, column)
    along = 0.0
    if left < math.inf:
        along += left - own
    if right < math.inf:
        along += own - right
    across = 0.0
    if below < math.inf:
        across += below - own
    if above < math.inf:
        across += own - above
    size = math.hypot(along, across)
    return complex(along / size, across / size) if size > 0.0 else 0j


@compiled
def _interpolated_slope(potential: Grid, here: complex) -> complex:
    """Return the slope between four cells; see `_slope`."""
    row = math.floor(here.imag)
    column = math.floor(here.real)
    up = here.imag - row
    right = here.real - column
    slope = 0j
    for r, c in ((0, 0), (0, 1), (1, 0), (1, 1)):
        share = (up if r else 1.0 - up) * (right if c else 1.0 - right)
        slope += share * _slope(potential, row + r, column + c)
    return slope


@compiled
def _near(potential: Grid, here: complex) -> float:
    """Return the potential of the cell at a point."""
    return _at(potential, round(here.imag), round(here.real))


@compiled
def _lowest(
    potential: Grid,
    here: complex,
    reach: int,
) -> complex:
    """Return the cell with the lowest potential among those at most `reach` cells from `here`."""
    row = round(here.imag)
    column = round(here.real)
    found = here
    least = math.inf
    for r in range(row - reach, row + reach + 1):
        for c in range(column - reach, column + reach + 1):
            if _at(potential, r, c) < least:
                found = complex(c, r)
                least = _at(potential, r, c)
    return found


@compiled
def _descend(
    potential: Grid,
    start: complex,
    goal: complex,
) -> NDArray[np.complex128]:
    """Return a path down the interpolated gradient as points in cells, shape (n,).

    Empty without a path.
    """
    cells = np.empty(potential.size + 2, dtype=np.complex128)
    cells[0] = start
    count = 1
    here = start
    if _near(potential, start) == math.inf:
        here = _lowest(potential, start, 4)  # the robot is too near to an obstacle
        if _near(potential, here) == math.inf:
            return cells[:0]
    while abs(goal - here) > 1.0 and count < len(cells) - 1:
        slope = _interpolated_slope(potential, here)
        after = here
        if abs(slope) > 0.1:
            after += _PATH_STEP * slope / abs(slope)
        if after == here or _near(potential, after) > _near(potential, here):
            after = _lowest(potential, here, 1)
        if after == here:
            break
        here = after
        cells[count] = here
        count += 1
    cells[count] = goal
    return cells[: count + 1]
