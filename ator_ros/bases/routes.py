"""Routes on a map: the shortest any-angle routes between places, found by table look-ups.

For each goal place a *field* is computed once and cached: the routes to it from all cells of the
map. It has the *parent* of each cell, which is the first place at which the route from there bends,
and tables of the route's length, least clearance, turn and heading at the end (`Tables`). The route
between two places is read from the field of one of them, as the straight line to a parent and the
parent's entries in the tables.

Fields are computed by Lazy Theta* (Nash, Koenig and Tovey, AAAI 2010) without a heuristic. On large
maps a field covers a window around its goal, which grows until no route can lead around it. If the
map has a planner, the routes are its paths instead, as long as it is not busy.

The cells of routes are those of the map, or blocks of them, which are so small for the robot that
two free blocks side by side have no wall between them, however thin.
"""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ator_ros.bases.description import Robot
from ator_ros.bases.planned_routes import route_along
from ator_ros.compiled import compiled
from ator_ros.files import FileError
from ator_ros.geometry import BoolArray, FloatArray, Pose, wrap_angles
from ator_ros.world.grid_map import GridMap, Planner, PlannerBusyError

LOOK_AHEAD = 0.5
"""Length in m of the ends of a route, over which departure and arrival are averaged."""
CLEARANCES = (0.35, 0.25, 0.15, 0.05, 0.0)
"""Distances in m between robot and obstacles, of which a whole route keeps one.

It is the largest at which start and goal, or the nearest free cells to them, are connected.
Planners prefer such a distance, as Nav2 does with its inflation layer."""
_CELL = 0.1  # m; a usual side of a cell
# Least radius of the robot in sides of a cell, where a cell is a block of k x k cells of the map.
# The places with the greatest clearance in two blocks side by side are at most
# √((2k - 1)² + (k - 1)²) apart, less than √5 k. If each keeps a radius of more than half of that
# and 0.71 cells of the map from obstacles, the line between them crosses no wall, not even one of
# cells that touch at corners.
_LEAST_RADIUS = 1.15
_MOST_CELLS = 16_000_000  # 400 x 400 m; 45 bytes each
# of a first window; its field takes 40 ms
_WINDOW_CELLS = 250_000
_WINDOW_REACH = 250
# Cells by which clearances may be too large: a cell has the greatest one in it, and its diagonal is
# √2 cells. A start or goal may be nearer to an obstacle by as much, which allows for errors of
# localization, too.
_TOLERANCE = 1.5
_FIELD_BYTES = 200_000_000  # memory of the cached fields of a map, unless a single one has more
# up to so many pairs in one call are cached; size of that cache
_FEW = 64
_CACHED_PAIRS = 20_000
_PLANNING = threading.Lock()  # a planner may be a client that only one thread may use at a time
_BUCKETS = 4.0  # buckets of the queue per cell of length
Cells = NDArray[np.int32]
Table = NDArray[np.float32]
Places = NDArray[np.complex128]
Tables = tuple[Table, Table, Table, Table]
"""The route from each cell: length and least clearance in cells; turn and last heading in rad.

Clearances are known for all cells, the others only where routes bend."""


class RouteSet(NamedTuple):
    """Routes between n pairs of places, arrays of shape (n,); NaN where there is none."""

    length: FloatArray  # m
    turn: FloatArray  # rad; sum of the angles turned at bends
    clearance: FloatArray  # m; least distance from an obstacle
    departure: FloatArray  # rad; heading over the first `LOOK_AHEAD`
    arrival: FloatArray  # rad; heading over the last `LOOK_AHEAD`
    straight: BoolArray  # whether it has no bends


class _Field(NamedTuple):
    """The routes to one place from the cells of a window of the map, which its own cells number."""

    low: int  # row and column of the map at which the window begins
    left: int
    rows: int
    columns: int
    reach: float  # cells from the goal to the edges of the window; infinite if it is the map
    goal: int
    parent: Cells
    tables: Tables

    def cells(self, cells: Cells, columns: int) -> Cells:
        """Return cells of a map with so many columns as cells of the window, -1 outside."""
        row = cells // columns - self.low
        column = cells % columns - self.left
        inside = (row >= 0) & (row < self.rows) & (column >= 0) & (column < self.columns)
        return np.where(inside, row * self.columns + column, -1).astype(np.int32)


class Routes:
    """The search for routes on a map, with its cache of fields; it returns routes as a `RouteSet`.

    `radius` is the least distance in m of the robot's axle from an obstacle.
    """

    def __init__(self, grid: GridMap, radius: float) -> None:
        from scipy import ndimage  # slow to import, and needed with a map only

        self.grid = grid
        self.radius = radius
        rows, columns = grid.free.shape
        finest = math.floor(radius / (_LEAST_RADIUS * grid.resolution) + 1e-9)
        step = max(min(round(_CELL / grid.resolution), finest), 1)
        self._step = step
        self._cell = step * grid.resolution
        if rows * columns > _MOST_CELLS * step**2:
            width = columns * grid.resolution
            height = rows * grid.resolution
            raise FileError(
                f"{grid.name}: expected at most {_MOST_CELLS / 1e6:g} million cells of "
                f"{self._cell:g} m, which a robot {2.0 * radius:g} m wide needs, "
                f"got {width:.0f} x {height:.0f} m; use "
                "a part of this map"
            )
        self._map = np.pad(grid.free, ((0, -rows % step), (0, -columns % step)))
        # The greatest clearance in a cell counts, so that narrow doors stay open.
        self._clearance, self._clearest = _clearances(self._map, step)
        usable = self._clearance > radius / self._cell - _TOLERANCE
        # For each of `CLEARANCES`: free cells, the nearest one to each cell, and connected
        # components.
        frees = []
        nearest = []
        components = []
        for distance in CLEARANCES:
            free = self._clearance > (radius + distance) / self._cell
            nearest.append(
                _nearest_free(
                    free,
                    usable,
                    _offsets(distance / self._cell + _TOLERANCE),
                    self._map,
                    self._clearest,
                )
            )
            components.append(ndimage.label(free)[0].ravel())
            frees.append(free)
        self._free: BoolArray = np.stack(frees)
        self._nearest: Cells = np.stack(nearest)
        self._component: Cells = np.stack(components).astype(np.int32)
        self._fields: OrderedDict[tuple[int, complex], _Field] = OrderedDict()
        self._cached = lru_cache(_CACHED_PAIRS)(
            lambda *pair: self._searched(np.array([pair]).T)[:, 0]
        )
        # of the map's planner: paths between cells, and the routes along them between exact places
        self._paths: dict[tuple[int, ...], FloatArray] = {}
        self._along: dict[tuple[float, ...], FloatArray] = {}
        open_cells = np.argwhere(self._free[-1])
        if not len(open_cells):
            raise FileError(
                f"{grid.name}: expected a place {radius:g} m from obstacles, "
                "got none: check resolution"
            )
        place = np.array([complex(open_cells[0, 1], open_cells[0, 0])])
        self._routes(place, place)  # loads compiled code

    def between(self, x: FloatArray, y: FloatArray, to_x: FloatArray, to_y: FloatArray) -> RouteSet:
        """Return the routes from (x, y) to (to_x, to_y) in m, all of shape (n,).

        A field is computed for each distinct start or goal, whichever are fewer.
        """
        ends = np.stack([x, y, to_x, to_y])
        count = len(x)
        if (ends == ends[:, :1]).all():  # as in a search for headings
            ends = ends[:, :1]
        # planned paths have their own cache
        if 0 < ends.shape[1] <= _FEW and self.grid.planner is None:
            found = np.stack([self._cached(*pair) for pair in ends.T.tolist()], axis=1)
        else:
            found = self._between(ends)
        if ends.shape[1] < count:
            found = found.repeat(count, axis=1)
        length, turn, clearance, departure, arrival, straight = found
        return RouteSet(length, turn, clearance, departure, arrival, straight == 1.0)

    def _between(self, ends: FloatArray) -> FloatArray:
        """Return routes of pairs x, y, to_x, to_y in m, shape (4, n), as rows of a `RouteSet`."""
        if self.grid.planner is not None:
            differs = (ends[:, 1:] != ends[:, :-1]).any(axis=0)  # neighbors mostly differ in yaw
            rows = np.cumsum(np.append(0, differs))[: ends.shape[1]]
            firsts = np.append(True, differs)[: ends.shape[1]]
            pairs = [tuple(pair) for pair in ends[:, firsts].T.tolist()]
            planned = {
                pair: self._planned(self.grid.planner, *pair) for pair in dict.fromkeys(pairs)
            }
            return np.array([planned[pair] for pair in pairs]).reshape(-1, 6).T[:, rows]
        return self._searched(ends)

    def _searched(self, ends: FloatArray) -> FloatArray:
        """Return the routes on the map between pairs, whatever its planner; see `_between`."""
        found = self._routes(self._places(*ends[:2]), self._places(*ends[2:]))
        found[[0, 2]] *= self._cell
        found[3:5] = wrap_angles(found[3:5] + self.grid.origin.yaw)
        return found

    def _planned(
        self,
        planner: Planner,
        x: float,
        y: float,
        to_x: float,
        to_y: float,
    ) -> FloatArray:
        """Return the route along a planner's path between places in m: a column of a `RouteSet`."""
        found = self._along.get((x, y, to_x, to_y))
        if found is not None:
            return found
        key = _path_key(x, y, to_x, to_y)
        path = self._paths.get(key) if key[:2] != key[2:] else np.array([(x, y), (to_x, to_y)])
        if path is None:
            try:
                with _PLANNING:
                    path = planner((x, y), (to_x, to_y))
            except PlannerBusyError:  # not cached: it is asked again later
                return self._cached(x, y, to_x, to_y)
            if path is None:  # not cached: a planner may find a path later
                return np.full(6, np.nan)
            if len(self._paths) >= _CACHED_PAIRS:
                self._paths.clear()
            self._paths[key] = path
        if len(self._along) >= _CACHED_PAIRS:
            self._along.clear()
        path = np.concatenate([[(x, y)], path[1:-1], [(to_x, to_y)]])
        length, turn, departure, arrival, straight = route_along(path, LOOK_AHEAD)
        clearance = self._cell * self._clearances(*path.T).min()
        found = np.array([length, turn, clearance, departure, arrival, straight])
        self._along[x, y, to_x, to_y] = found
        return found

    def corners(self, start: Sequence[float], goal: Sequence[float]) -> FloatArray:
        """Return start, bends and goal of the route between two places in m, shape (n, 2).

        Of a planner's route these are all places of its path. Without a route the line between both
        places has no bends.
        """
        ends = np.array([*start[:2], *goal[:2]], dtype=float)
        if np.isnan(self.between(*ends[:, None]).length[0]):
            return ends.reshape(2, 2)
        if self.grid.planner is not None:
            bends = self._paths.get(_path_key(*ends), np.empty((2, 2)))[1:-1]
            if len(bends) or np.isnan(self._searched(ends[:, None])[0, 0]):
                return np.concatenate([[ends[:2]], bends, [ends[2:]]])
        starts = self._places(*ends[:2, None])
        goals = self._places(*ends[2:, None])
        self._routes(starts, goals)
        cells = self._cells(np.concatenate([starts, goals]))
        level = int(_levels(self._nearest, self._component, cells[:1], cells[1:])[0])
        field = self._fields[level, complex(goals[0])]
        cell = int(field.cells(self._nearest[level, cells[:1]], self._clearance.shape[1])[0])
        places = [(float(ends[0]), float(ends[1]))]
        while field.parent[cell] != field.goal:
            cell = int(field.parent[cell])
            row, column = divmod(cell, field.columns)
            x = self._cell * (field.left + column + 0.5)
            y = self._cell * (field.low + row + 0.5)
            places.append(self.grid.origin.compose(Pose(x, y, 0.0))[:2])
        return np.array([*places, (float(ends[2]), float(ends[3]))])

    def connected(self, ends: FloatArray) -> BoolArray:
        """Return whether there are routes from x, y to to_x, to_y in m, shape (4, n)."""
        starts, goals = (self._cells(self._places(*pair)) for pair in (ends[:2], ends[2:]))
        return np.asarray(_levels(self._nearest, self._component, starts, goals) >= 0)

    def fault(
        self,
        x: float,
        y: float,
        start: tuple[float, float] | None = None,
        *,
        planned: bool = False,
    ) -> str | None:
        """Return why a place in m cannot be reached from `start`, or from anywhere; else None.

        With `planned`, the planner of the map must find a path from `start`, too.
        """
        ends = np.array([[*((x, y) if start is None else start), x, y]]).T
        if self.connected(ends)[0] and not (planned and np.isnan(self.between(*ends).length[0])):
            return None
        wanted = f"free space, {self.radius:.2f} m from obstacles"
        if start is not None and self.connected(ends[[2, 3, 2, 3]])[0]:
            wanted = f"reach of x {start[0]:.2f} m, y {start[1]:.2f} m"
        return f"expected a place in {wanted}, on the map {self.grid}, got x {x:.2f} m, y {y:.2f} m"

    def clearance(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return lower bounds in m, up to 0.2 m too low, of distances of places from obstacles."""
        return self._cell * np.maximum(self._clearances(x, y) - _TOLERANCE, 0.0)

    def _clearances(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the clearances at places in m, in cells; 0 outside the map."""
        cells = self._cells(self._places(x, y))
        return np.where(cells < 0, 0.0, self._clearance.ravel()[cells])

    def _routes(self, starts: Places, goals: Places) -> FloatArray:
        """Return routes between places in cells, shape (6, n), lengths in cells: see `RouteSet`."""
        from_cells = self._cells(starts)
        to_cells = self._cells(goals)
        levels = _levels(self._nearest, self._component, from_cells, to_cells)
        ends = _distinct(goals)
        others = _distinct(starts)
        backward = len(others) < len(ends)
        if backward:
            starts, goals, from_cells, to_cells, ends = goals, starts, to_cells, from_cells, others
        found = np.full((6, len(starts)), np.nan)
        for end in ends:
            to_end = np.flatnonzero(goals == end) if len(ends) > 1 else np.arange(len(goals))
            for level in np.unique(levels[to_end]):
                if level >= 0:
                    which = to_end[levels[to_end] == level]
                    goal = self._nearest[level, to_cells[which[0]]]
                    cells = self._nearest[level, from_cells[which]]
                    found[:, which] = self._routes_to(
                        complex(end),
                        int(goal),
                        starts[which],
                        cells,
                        int(level),
                    )
        if backward:
            departures = found[3] + math.pi
            found[3] = found[4] + math.pi
            found[4] = departures
        return found

    def _places(self, x: FloatArray, y: FloatArray) -> Places:
        """Return places in m in cells; whole numbers are the middles of cells."""
        along, across = self.grid.cells(x, y)
        return np.asarray((along + 1j * across) / self._step - (0.5 + 0.5j))

    def _cells(self, places: Places) -> NDArray[np.intp]:
        """Return the cells in which places lie, -1 outside the map."""
        found = _cells_of(
            places.ravel(),
            self._clearance.shape,
            self._step,
            self._map,
            self._clearest,
        )
        return found.reshape(places.shape)

    def _routes_to(
        self,
        end: complex,
        goal: int,
        starts: Places,
        cells: Cells,
        level: int,
    ) -> FloatArray:
        """Return routes to a place, in the cell `goal`, from starts in `cells`, shape (6, n)."""
        columns = self._clearance.shape[1]
        look = LOOK_AHEAD / self._cell
        field = self._fields.get((level, end))
        if field is None:
            field = self._field(level, goal, end, _WINDOW_REACH)
        self._fields.move_to_end((level, end))
        while True:
            corner = complex(field.left, field.low)
            inside = field.cells(cells, columns)
            found = _look_up(
                starts - corner,
                inside,
                field.parent,
                field.tables,
                field.columns,
                field.goal,
                end - corner,
                look,
            )
            # A route that leaves the window is longer than the way from the goal to its edge.
            if (found[0] <= field.reach).all():
                return found
            field = self._field(level, goal, end, 2 * int(field.reach))

    def _field(self, level: int, goal: int, end: complex, reach: int) -> _Field:
        """Return, and cache, the field of a place, in the cell `goal`, in a window.

        The edges of the window are at least `reach` cells from the goal, or those of the map.
        """
        rows, columns = self._clearance.shape
        row, column = divmod(goal, columns)
        low = max(row - reach, 0)
        high = min(row + reach + 1, rows)
        left = max(column - reach, 0)
        right = min(column + reach + 1, columns)
        if rows * columns <= _WINDOW_CELLS:
            low = 0
            high = rows
            left = 0
            right = columns
        whole = (high - low, right - left) == (rows, columns)
        free = np.ascontiguousarray(self._free[level, low:high, left:right])
        clearance = np.ascontiguousarray(self._clearance[low:high, left:right]).ravel()
        inside = (row - low) * (right - left) + column - left
        parent, order = _parents(free, inside)
        corner = complex(left, low)
        look = LOOK_AHEAD / self._cell
        tables = _tables(parent, order, right - left, end - corner, clearance, look)
        field = _Field(
            low=low,
            left=left,
            rows=high - low,
            columns=right - left,
            reach=math.inf if whole else reach,
            goal=inside,
            parent=parent,
            tables=tables,
        )
        self._fields[level, end] = field
        size = sum(20 * len(other.parent) for other in self._fields.values())
        while size > _FIELD_BYTES and len(self._fields) > 1:
            size -= 20 * len(self._fields.popitem(last=False)[1].parent)
        return field


class _ThreadRoutes(threading.local):
    """The routes that one thread computed: their caches change with each request."""

    def __init__(self) -> None:
        self.on = lru_cache(maxsize=1)(Routes)  # of a large map they have GB


_routes = _ThreadRoutes()


def routes_of(robot: Robot) -> Routes | None:
    """Return the routes of a robot on its map, computed once in each thread; None without a map.

    They keep half of the robot's width from obstacles: no robot drives where its sides touch.
    """
    return None if robot.grid is None else _routes.on(robot.grid, robot.half_width)


def reachable(places: Sequence[Pose], robot: Robot) -> bool:
    """Return whether the robot can turn at places on its map, with routes from each to the next."""
    routes = routes_of(robot)
    if routes is None:
        return True
    x, y = np.array([place[:2] for place in places], dtype=float).reshape(-1, 2).T
    connected = routes.connected(np.stack([x[:-1], y[:-1], x[1:], y[1:]]))
    return bool((routes.clearance(x, y) > robot.reach).all() and connected.all())


def arrival_heading(start: Sequence[float], goal: Pose, robot: Robot) -> float:
    """Return the heading in rad in which a robot arrives from x, y (m), along the route if any."""
    routes = routes_of(robot)
    found = math.nan
    if routes is not None:
        found = routes.between(*np.array([[*start, *goal[:2]]], dtype=float).T).arrival[0]
    return math.atan2(goal.y - start[1], goal.x - start[0]) if math.isnan(found) else found


def _path_key(*ends: float) -> tuple[int, ...]:
    """Return the key of a planner's path: stops differ by centimeters."""
    return tuple(round(value / _CELL) for value in ends)


def _distinct(places: Places) -> Places:
    alike = (places == places[:1]).all()  # as in most searches
    return places[:1] if alike else np.unique(places)


@compiled
def _levels(
    nearest: Cells,
    component: Cells,
    starts: NDArray[np.intp],
    goals: NDArray[np.intp],
) -> Cells:
    """Return the index in `CLEARANCES` of the routes between cells, shape (n,).

    -1 without a route.
    """
    levels = np.full(len(starts), -1, dtype=np.int32)
    for at in range(len(starts)):
        if starts[at] < 0 or goals[at] < 0:
            continue
        for level in range(len(nearest)):
            start = nearest[level, starts[at]]
            goal = nearest[level, goals[at]]
            if start >= 0 and goal >= 0 and component[level, start] == component[level, goal]:
                levels[at] = level
                break
    return levels


@compiled
def _line_of_sight(free: BoolArray, cell: int, other: int) -> bool:
    """Return whether the cells on the line between two cells are free.

    Of the two cells beside a diagonal step one must be: else a thin wall leads between them.
    """
    columns = free.shape[1]
    row, column = divmod(cell, columns)
    down = other // columns - row
    right = other % columns - column
    steps = max(abs(down), abs(right))
    before_row = row
    before_column = column
    for step in range(1, steps + 1):
        share = step / steps
        at_row = row + math.floor(share * down + 0.5)
        at_column = column + math.floor(share * right + 0.5)
        if step < steps and not free[at_row, at_column]:
            return False
        is_diagonal = at_row != before_row and at_column != before_column
        if is_diagonal and not (free[at_row, before_column] or free[before_row, at_column]):
            return False
        before_row = at_row
        before_column = at_column
    return True


@compiled
def _clearances(free: BoolArray, step: int) -> tuple[Table, Cells]:
    """Return the greatest clearance in each block of `step` x `step` cells of the map, and where.

    Clearances are exact distances from the nearest obstacle (Meijster, Roerdink, Hesselink 2000),
    in blocks; beyond the map are obstacles. The places are cells of the map.
    """
    rows, columns = free.shape
    across = np.zeros((rows, columns), dtype=np.int32)  # distance within the column
    for row in range(rows):
        for column in range(columns):
            if free[row, column]:
                across[row, column] = 1 + (across[row - 1, column] if row > 0 else 0)
    for row in range(rows - 1, -1, -1):
        for column in range(columns):
            below = across[row + 1, column] if row + 1 < rows else 0
            across[row, column] = min(across[row, column], below + 1)
    blocks = columns // step
    greatest = np.full((rows // step, blocks), -1.0, dtype=np.float32)
    clearest = np.zeros(rows // step * blocks, dtype=np.int32)
    # The nearest obstacle of places from `first[part]` on is in the column `nearest[part]`
    # on. Columns count from 1; 0 and the last one are beyond the map.
    nearest = np.zeros(columns + 2, dtype=np.int64)
    first = np.zeros(columns + 2, dtype=np.int64)
    squares = np.zeros(columns + 2, dtype=np.int64)
    for row in range(rows):
        for column in range(columns):
            squares[column + 1] = np.int64(across[row, column]) ** 2
        nearest[0] = 0
        first[0] = 0
        part = 0
        for column in range(1, columns + 2):
            while part >= 0:
                other = nearest[part]
                place = first[part]
                if (place - other) ** 2 + squares[other] <= (place - column) ** 2 + squares[column]:
                    break
                part -= 1
            begin = 0
            if part >= 0:
                other = nearest[part]
                further = column**2 - other**2 + squares[column] - squares[other]
                begin = 1 + further // (2 * (column - other))
            if begin < columns + 2:
                part += 1
                nearest[part] = column
                first[part] = begin
        for place in range(columns + 1, 0, -1):
            if place <= columns:
                distance = math.sqrt((place - nearest[part]) ** 2 + squares[nearest[part]])
                value = np.float32(distance / step)
                block = row // step, (place - 1) // step
                if value > greatest[block]:
                    greatest[block] = value
                    clearest[block[0] * blocks + block[1]] = row * columns + place - 1
            if place == first[part]:
                part -= 1
    return greatest, clearest


def _offsets(most: float) -> Cells:
    """Return the steps to cells at most so many cells away, shape (n, 2), nearest first."""
    reach = np.arange(-int(most), int(most) + 1)
    right, down = (values.ravel() for values in np.meshgrid(reach, reach, indexing="ij"))
    squares = down**2 + right**2
    order = np.argsort(squares, kind="stable")
    return np.stack([down, right], axis=1)[order[squares[order] <= most**2]].astype(np.int32)


@compiled
def _nearest_free(
    free: BoolArray,
    usable: BoolArray,
    offsets: Cells,
    whole: BoolArray,
    clearest: Cells,
) -> Cells:
    """Return the free cell nearest to each usable one, at one of `offsets`, else -1.

    On the line between them all cells of the map, `whole`, are free.
    """
    rows, columns = free.shape
    nearest = np.full(rows * columns, -1, dtype=np.int32)
    for row in range(rows):
        for column in range(columns):
            if not usable[row, column]:
                continue
            cell = row * columns + column
            for step in range(len(offsets)):
                down = row + offsets[step, 0]
                right = column + offsets[step, 1]
                if not (0 <= down < rows and 0 <= right < columns and free[down, right]):
                    continue
                other = down * columns + right
                if _line_of_sight(whole, clearest[cell], clearest[other]):
                    nearest[cell] = other
                    break
    return nearest


@compiled
def _cells_of(
    places: Places,
    shape: tuple[int, int],
    step: int,
    free: BoolArray,
    clearest: Cells,
) -> NDArray[np.intp]:
    """Return the cells in which places lie, -1 outside the map and behind a wall in the cell."""
    rows, columns = shape
    found = np.full(len(places), -1, dtype=np.intp)
    for at in range(len(places)):
        row = places[at].imag + 0.5
        column = places[at].real + 0.5
        if not (0.0 <= row < rows and 0.0 <= column < columns):
            continue
        cell = int(row) * columns + int(column)
        place_row = min(int(row * step), rows * step - 1)
        place = place_row * columns * step + min(int(column * step), columns * step - 1)
        if _line_of_sight(free, place, clearest[cell]):
            found[at] = cell
    return found


@compiled
def _beside_connected(settled: BoolArray, parent: Cells, columns: int, cell: int) -> bool:
    """Return whether both neighbors beside the line to the parent of a cell have that parent.

    Then it has a line of sight, which takes longer to check.
    """
    goal = parent[cell]
    down = goal // columns - cell // columns
    right = goal % columns - cell % columns
    down1 = int(np.sign(down))
    right1 = int(np.sign(right))
    diagonal = straight = cell + down1 * columns + right1
    if abs(down) > abs(right):
        straight = cell + down1 * columns
    elif abs(right) > abs(down):
        straight = cell + right1
    for beside in (diagonal, straight):
        if not settled[beside] or (parent[beside] != goal and beside != goal):
            return False
    return True


@compiled
def _neighbors(free: BoolArray, cell: int, neighbors: Cells) -> int:
    """Write the cells next to `cell` that can be entered from there, and return their number."""
    rows, columns = free.shape
    row, column = divmod(cell, columns)
    count = 0
    for r in range(max(row - 1, 0), min(row + 2, rows)):
        for c in range(max(column - 1, 0), min(column + 2, columns)):
            if free[r, c] and free[row, c] and free[r, column]:
                neighbors[count] = r * columns + c
                count += 1
    return count


@compiled
def _distance(cell: int, other: int, columns: int) -> float:
    return math.hypot(cell // columns - other // columns, cell % columns - other % columns)


@compiled
def _parents(free: BoolArray, goal: int) -> tuple[Cells, Cells]:
    """Return the parent of each cell, -1 where no route leads, and the cells by length."""
    rows, columns = free.shape
    count = rows * columns
    parent = np.full(count, -1, dtype=np.int32)
    length = np.full(count, np.inf)
    settled = np.zeros(count, dtype=np.bool_)
    neighbors = np.empty(9, dtype=np.int32)
    order = np.empty(count, dtype=np.int32)
    done = 0
    # The queue: for each bucket of lengths a linked list. The buckets form a ring, longer than any
    # step.
    first = np.full(int(2 * _BUCKETS * (rows + columns)), -1, dtype=np.int32)
    queued = np.empty(8 * count + 1, dtype=np.int32)
    after = np.empty(8 * count + 1, dtype=np.int32)
    parent[goal] = goal
    length[goal] = 0.0
    queued[0] = goal
    after[0] = -1
    first[0] = 0
    pushed = 1
    waiting = 1
    bucket = 0
    while waiting > 0:
        while first[bucket % len(first)] < 0:
            bucket += 1
        entry = first[bucket % len(first)]
        first[bucket % len(first)] = after[entry]
        waiting -= 1
        cell = queued[entry]
        if settled[cell]:
            continue
        near = _neighbors(free, cell, neighbors)
        candidate = parent[cell]
        if not _beside_connected(settled, parent, columns, cell) and not _line_of_sight(
            free,
            cell,
            candidate,
        ):
            length[cell] = np.inf
            for other in neighbors[:near]:
                if settled[other]:
                    beyond = parent[other]
                    if beyond == candidate or not _line_of_sight(free, cell, beyond):
                        beyond = other
                    total = length[beyond] + _distance(cell, beyond, columns)
                    if total < length[cell]:
                        length[cell] = total
                        parent[cell] = beyond
            candidate = parent[cell]
        settled[cell] = True
        order[done] = cell
        done += 1
        for other in neighbors[:near]:
            total = length[candidate] + _distance(other, candidate, columns)
            if not settled[other] and total < length[other]:
                length[other] = total
                parent[other] = candidate
                place = max(int(_BUCKETS * total), bucket) % len(first)
                queued[pushed] = other
                after[pushed] = first[place]
                first[place] = pushed
                pushed += 1
                waiting += 1
    return parent, order[:done]


@compiled
def _place(cell: int, columns: int, goal: int, end: complex) -> complex:
    """Return the middle of a cell; of the goal's, its exact place."""
    return end if cell == goal else complex(cell % columns, cell // columns)


@compiled
def _heading(vector: complex) -> float:
    return math.atan2(vector.imag, vector.real)


@compiled
def _turned(before: complex, after: complex) -> float:
    """Return the angle in rad between two directions."""
    return abs(_heading(after * before.conjugate()))


@compiled
def _arrival(start: complex, first: complex, rest: float, end: complex, look: float) -> float:
    """Return the heading in rad at the end of a route, `rest` long after its first part."""
    share = max(abs(first) + rest - look, 0.0) / max(abs(first), 1e-9)
    return _heading(end - start - share * first)


@compiled
def _tables(
    parent: Cells,
    order: Cells,
    columns: int,
    end: complex,
    clearance: Table,
    look: float,
) -> Tables:
    """Return the tables of a field to the exact place `end`; see `Tables`."""
    length = np.zeros(len(parent), dtype=np.float32)
    turn = np.zeros(len(parent), dtype=np.float32)
    least = clearance.copy()
    arrival = np.zeros(len(parent), dtype=np.float32)
    goal = order[0]
    bends = np.zeros(len(parent), dtype=np.bool_)
    for cell in order:
        bends[parent[cell]] = True
    for cell in order[1:]:
        bend = parent[cell]
        here = complex(cell % columns, cell // columns)
        first = _place(bend, columns, goal, end) - here
        step = here + first / max(abs(first.real), abs(first.imag), 1.0)
        ahead = int(step.imag + 0.5) * columns + int(step.real + 0.5)
        least[cell] = min(clearance[cell], least[ahead if parent[ahead] == bend else bend])
        if bends[cell]:
            length[cell] = length[bend] + abs(first)
            arrival[cell] = arrival[bend]
            if length[bend] < look:
                arrival[cell] = _arrival(here, first, length[bend], end, look)
            if bend != goal:
                second = _place(parent[bend], columns, goal, end) - here - first
                turn[cell] = turn[bend] + _turned(first, second)
    return length, least, turn, arrival


@compiled
def _look_up(
    starts: Places,
    cells: Cells,
    parent: Cells,
    tables: Tables,
    columns: int,
    goal: int,
    end: complex,
    look: float,
) -> FloatArray:
    """Return the routes to `end` from n starts in `cells`, shape (6, n), as in `RouteSet`."""
    length, least, turn, arrival = tables
    found = np.empty((6, len(starts)))
    for at in range(len(starts)):
        start = starts[at]
        cell = cells[at]
        if cell < 0 or parent[cell] < 0:  # beyond the window, or connected beyond it
            found[:, at] = np.inf
            continue
        bend = parent[cell]
        place = _place(bend, columns, goal, end)
        first = place - start
        found[0, at] = abs(first) + length[bend]
        found[1, at] = 0.0
        found[2, at] = least[cell]
        found[3, at] = _heading(first)
        found[4, at] = _heading(first)
        found[5, at] = bend == goal
        if bend == goal:
            continue
        second = _place(parent[bend], columns, goal, end) - place
        found[1, at] = turn[bend] + _turned(first, second)
        found[4, at] = arrival[bend]
        if length[bend] < look:
            found[4, at] = _arrival(start, first, length[bend], end, look)
        left = look
        begin = start
        part = first
        while abs(part) < left and bend != goal:
            left -= abs(part)
            begin = place
            bend = parent[bend]
            place = _place(bend, columns, goal, end)
            part = place - begin
        found[3, at] = _heading(begin + min(left / max(abs(part), 1e-9), 1.0) * part - start)
    return found
