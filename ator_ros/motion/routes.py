"""Routes on a map: for a place, a field of the shortest any-angle routes from everywhere else.

A field is made by Lazy Theta* (Nash, Koenig and Tovey, AAAI 2010) without a heuristic: each cell refers to
the *corner* at which its route bends first. Routes are then found by table look-ups.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ator_ros.compiled import compiled
from ator_ros.files import FileError
from ator_ros.geometry import BoolArray, FloatArray, Pose, wrap_angles
from ator_ros.motion.planned_routes import measured_path
from ator_ros.robot.description import Robot
from ator_ros.world.grid_map import GridMap, Planner

LOOK_AHEAD = 0.5
"""Length in m of the ends of a route, over which its headings at departure and arrival are taken."""
MARGINS = (0.35, 0.25, 0.15, 0.05, 0.0)
"""Distances in m that a route keeps from obstacles besides the robot's: the first that the places allow.

Planners prefer to keep such a distance: Nav2's inflation layer does."""
_CELL, _MOST_CELLS = 0.1, 250_000  # m; so a field takes 40 ms
_OFF_FREE = 1.5  # cells by which a place may lie too near to an obstacle: localization errs
_FIELD_BYTES = 200_000_000  # that the fields of a map may take
_FEW, _MOST_PAIRS = 64, 20_000  # of which routes are remembered
_BUCKETS = 4.0  # of the queue, per cell of length
Cells = NDArray[np.int32]
Table = NDArray[np.float32]
Places = NDArray[np.complex128]
Tables = tuple[Table, Table, Table, Table]
"""By cell, of the route from it: length and least room in cells, turn and heading at its end in rad.

All but the room are known at the corners of routes only."""


class RouteSet(NamedTuple):
    """Routes of n pairs of places, shape (n,); NaN where there is none.

    Attributes
    ----------
    length, turn, clearance : ndarray
        Length in m, sum of the angles turned at corners in rad, and least distance from an obstacle in m.
    departure, arrival : ndarray
        Headings in rad, over the first and the last `LOOK_AHEAD`.
    straight : ndarray
        Whether it has no corners.
    """

    length: FloatArray
    turn: FloatArray
    clearance: FloatArray
    departure: FloatArray
    arrival: FloatArray
    straight: BoolArray


class Routes:
    """The shortest routes on a map for a robot, with a cache of fields.

    Parameters
    ----------
    grid : GridMap
        The map.
    radius : float
        Least distance in m of the robot's axle from an obstacle.
    """

    def __init__(self, grid: GridMap, radius: float) -> None:
        from scipy import ndimage  # only those who have a map need it

        self.grid, self.radius = grid, radius
        rows, columns = grid.free.shape
        step = max(round(_CELL / grid.resolution), math.ceil(math.sqrt(rows * columns / _MOST_CELLS)), 1)
        self._step, self._cell = step, step * grid.resolution
        padded = np.pad(grid.free, ((1, 1 + -rows % step), (1, 1 + -columns % step)))
        room = ndimage.distance_transform_edt(padded)[1:-1, 1:-1] / step
        # The roomiest place of a cell counts, so that narrow doors stay open.
        blocks = room.reshape(room.shape[0] // step, step, room.shape[1] // step, step)
        self._room: Table = blocks.max(axis=(1, 3)).astype(np.float32)
        usable = self._room > radius / self._cell - _OFF_FREE
        frees, entries, parts = [], [], []
        for margin in MARGINS:
            free = self._room > (radius + margin) / self._cell
            away, (row, column) = ndimage.distance_transform_edt(~free, return_indices=True)
            near = usable & (away <= margin / self._cell + _OFF_FREE) & free.any()
            entries.append(np.where(near, row * free.shape[1] + column, -1).ravel())
            parts.append(ndimage.label(free, np.ones((3, 3)))[0].ravel())
            frees.append(free)
        self._free: BoolArray = np.stack(frees)
        self._entry: Cells = np.stack(entries).astype(np.int32)
        self._part: Cells = np.stack(parts).astype(np.int32)
        self._fields: OrderedDict[tuple[int, complex], tuple[Cells, Tables]] = OrderedDict()
        self._pairs: dict[bytes, FloatArray] = {}
        self._paths: dict[tuple[int, ...], FloatArray | None] = {}  # of the map's planner
        free = np.argwhere(self._free[-1])
        if not len(free):
            raise FileError(
                f"{grid.name}: expected a place {radius:g} m from obstacles, got none: check resolution"
            )
        place = np.array([complex(free[0, 1], free[0, 0])])
        self._routes(place, place)  # loads compiled code

    def between(self, x: FloatArray, y: FloatArray, to_x: FloatArray, to_y: FloatArray) -> RouteSet:
        """Return the routes from (x, y) to (to_x, to_y) in m, all of shape (n,).

        A field is made for each distinct place of starts or goals, whichever have fewer.
        """
        ends = np.stack([x, y, to_x, to_y])
        count = ends.shape[1]
        if count and (ends == ends[:, :1]).all():  # as in a search for headings
            found = self._remembered(ends[:, :1]).repeat(count, axis=1)
        else:
            few = count <= _FEW or self.grid.planner is not None
            found = self._remembered(ends) if few else self._between(ends)
        length, turn, clearance, departure, arrival, straight = found
        return RouteSet(length, turn, clearance, departure, arrival, straight == 1.0)

    def _remembered(self, ends: FloatArray) -> FloatArray:
        """Return the routes of a few pairs of places as `_between` does, and remember them."""
        keys = [column.tobytes() for column in ends.T]
        new = [number for number, key in enumerate(keys) if key not in self._pairs]
        if new:
            if len(self._pairs) > _MOST_PAIRS:
                self._pairs.clear()
                new = list(range(len(keys)))
            found = self._between(ends[:, new])
            self._pairs |= {keys[number]: found[:, at] for at, number in enumerate(new)}
        return np.stack([self._pairs[key] for key in keys], axis=1)

    def _between(self, ends: FloatArray) -> FloatArray:
        """Return the routes of pairs x, y, to_x, to_y in m, shape (4, n): the rows of a `RouteSet`."""
        if self.grid.planner is not None:
            return np.stack([self._planned(self.grid.planner, *pair) for pair in ends.T.tolist()], axis=1)
        found = self._routes(self._places(*ends[:2]), self._places(*ends[2:]))
        found[[0, 2]] *= self._cell
        found[3:5] = wrap_angles(found[3:5] + self.grid.origin.yaw)
        return found

    def _planned(self, planner: Planner, x: float, y: float, to_x: float, to_y: float) -> FloatArray:
        """Return the route along the path of a planner between two places in m, a column of a `RouteSet`."""
        key = tuple(round(value / _CELL) for value in (x, y, to_x, to_y))  # stops differ by centimeters
        if key not in self._paths:
            if len(self._paths) > _MOST_PAIRS:
                self._paths.clear()
            self._paths[key] = planner((x, y), (to_x, to_y))
        path = self._paths[key]
        if path is None:
            return np.full(6, np.nan)
        path = np.concatenate([[(x, y)], path[1:-1], [(to_x, to_y)]])
        length, turn, departure, arrival, straight = measured_path(path, LOOK_AHEAD)
        cells = self._cells(self._places(*path.T))
        clearance = self._cell * np.where(cells < 0, 0.0, self._room.ravel()[cells]).min()
        return np.array([length, turn, clearance, departure, arrival, straight])

    def lead(self, ends: FloatArray) -> BoolArray:
        """Return whether routes lead from x, y to to_x, to_y in m, shape (4, n)."""
        here, there = (self._cells(self._places(*pair)) for pair in (ends[:2], ends[2:]))
        return np.asarray(_levels(self._entry, self._part, here, there) >= 0)

    def fault(self, x: float, y: float, start: tuple[float, float] | None = None) -> str | None:
        """Return why no route leads to a place in m, from `start` or from anywhere; None if one does."""
        origin = (x, y) if start is None else start
        if self.lead(np.array([[*origin, x, y]]).T)[0]:
            return None
        wanted = f"free space, {self.radius:.2f} m from obstacles"
        if start is not None:
            wanted = f"reach of x {start[0]:.2f} m, y {start[1]:.2f} m"
        return f"expected a place in {wanted}, on the map {self.grid}, got x {x:.2f} m, y {y:.2f} m"

    def room(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return lower bounds in m, up to 0.2 m too low, of the distances of places from obstacles."""
        cells = self._cells(self._places(x, y))
        return np.where(cells < 0, 0.0, self._cell * np.maximum(self._room.ravel()[cells] - _OFF_FREE, 0.0))

    def _routes(self, starts: Places, goals: Places) -> FloatArray:
        """Return the routes between places in cells, shape (6, n), lengths in cells: see `RouteSet`."""
        here, there = self._cells(starts), self._cells(goals)
        level = _levels(self._entry, self._part, here, there)
        ends, others = _distinct(goals), _distinct(starts)
        backward = len(others) < len(ends)
        if backward:
            starts, goals, here, there, ends = goals, starts, there, here, others
        found = np.full((6, len(here)), np.nan)
        for end in ends:
            mine = np.flatnonzero(goals == end) if len(ends) > 1 else np.arange(len(goals))
            for number in np.unique(level[mine]):
                if number >= 0:
                    which = mine[level[mine] == number]
                    goal = self._entry[number, there[which[0]]]
                    entries = self._entry[number, here[which]]
                    field = self._field(int(number), int(goal), complex(end))
                    columns, look = self._room.shape[1], LOOK_AHEAD / self._cell
                    found[:, which] = _look_up(starts[which], entries, *field, columns, goal, end, look)
        if backward:
            found[3], found[4] = found[4] + math.pi, found[3] + math.pi
        return found

    def _places(self, x: FloatArray, y: FloatArray) -> Places:
        """Return places in m in cells; whole numbers are the middles of cells."""
        along, across = self.grid.cells(x, y)
        return np.asarray((along + 1j * across) / self._step - (0.5 + 0.5j))

    def _cells(self, places: Places) -> NDArray[np.intp]:
        """Return the cells in which places lie, -1 outside the map."""
        rows, columns = self._room.shape
        row, column = np.floor(places.imag + 0.5), np.floor(places.real + 0.5)
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        return np.where(inside, row * columns + column, -1.0).astype(np.intp)

    def _field(self, level: int, goal: int, end: complex) -> tuple[Cells, Tables]:
        """Return corners and tables of the routes to a place, in the cell `goal`."""
        key = level, end
        if key not in self._fields:
            corner, order = _corners(self._free[level], goal)
            look, room = LOOK_AHEAD / self._cell, self._room.ravel()
            self._fields[key] = corner, _tables(corner, order, self._room.shape[1], end, room, look)
            while len(self._fields) > max(4, _FIELD_BYTES // (20 * room.size)):
                self._fields.popitem(last=False)
        self._fields.move_to_end(key)
        return self._fields[key]


_routes_on = lru_cache(maxsize=4)(Routes)


def routes_of(robot: Robot) -> Routes | None:
    """Return the routes of a robot on its map, made once; None without a map.

    They keep half of the robot's width from obstacles: no robot drives where its sides touch.
    """
    return None if robot.grid is None else _routes_on(robot.grid, robot.half_width)


def reachable(places: Sequence[Pose], robot: Robot) -> bool:
    """Return whether the robot can turn at places on its map, and routes lead from each to the next."""
    routes = routes_of(robot)
    if routes is None:
        return True
    x, y = np.array([place[:2] for place in places], dtype=float).reshape(-1, 2).T
    lengths = routes.between(x[:-1], y[:-1], x[1:], y[1:]).length
    return bool((routes.room(x, y) > robot.reach).all() and np.isfinite(lengths).all())


def arrival_heading(start: Sequence[float], goal: Pose, robot: Robot) -> float:
    """Return the heading in rad in which a robot comes from x, y (m) to a goal, on its map if it has one."""
    routes, found = routes_of(robot), math.nan
    if routes is not None:
        found = routes.between(*np.array([[*start, *goal[:2]]], dtype=float).T).arrival[0]
    return math.atan2(goal.y - start[1], goal.x - start[0]) if math.isnan(found) else found


def _distinct(places: Places) -> Places:
    alike = (places == places[:1]).all()  # as in most searches
    return places[:1] if alike else np.unique(places)


@compiled
def _levels(entry: Cells, part: Cells, here: NDArray[np.intp], there: NDArray[np.intp]) -> Cells:
    """Return the number of the margin that routes between cells keep, shape (n,); -1 without a route."""
    level = np.full(len(here), -1, dtype=np.int32)
    for at in range(len(here)):
        if here[at] < 0 or there[at] < 0:
            continue
        for number in range(len(entry)):
            start, goal = entry[number, here[at]], entry[number, there[at]]
            if start >= 0 and goal >= 0 and part[number, start] == part[number, goal]:
                level[at] = number
                break
    return level


@compiled
def _sees(free: BoolArray, cell: int, other: int) -> bool:
    """Return whether the cells on the line between two cells are free."""
    columns = free.shape[1]
    row, column = cell // columns, cell % columns
    down, right = other // columns - row, other % columns - column
    steps = max(abs(down), abs(right))
    for step in range(1, steps):
        share = step / steps
        if not free[row + math.floor(share * down + 0.5), column + math.floor(share * right + 0.5)]:
            return False
    return True


@compiled
def _beside_seen(settled: BoolArray, corner: Cells, columns: int, cell: int) -> bool:
    """Return whether the two neighbors beside the line from a cell to its corner see that corner."""
    goal = corner[cell]
    down, right = goal // columns - cell // columns, goal % columns - cell % columns
    down1, right1 = int(np.sign(down)), int(np.sign(right))
    diagonal = straight = cell + down1 * columns + right1
    if abs(down) > abs(right):
        straight = cell + down1 * columns
    elif abs(right) > abs(down):
        straight = cell + right1
    for beside in (diagonal, straight):
        if not settled[beside] or (corner[beside] != goal and beside != goal):
            return False
    return True


@compiled
def _steps(free: BoolArray, cell: int, neighbors: Cells) -> int:
    """Write the cells next to `cell` that can be entered from there, and return their number."""
    rows, columns = free.shape
    row, column, count = cell // columns, cell % columns, 0
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
def _corners(free: BoolArray, goal: int) -> tuple[Cells, Cells]:
    """Return the corner of each cell, -1 where no route leads, and the cells in order of their lengths."""
    rows, columns = free.shape
    count = rows * columns
    corner, length = np.full(count, -1, dtype=np.int32), np.full(count, np.inf)
    settled, neighbors = np.zeros(count, dtype=np.bool_), np.empty(9, dtype=np.int32)
    order, done = np.empty(count, dtype=np.int32), 0
    # The queue: for each bucket of lengths a linked list. The buckets form a ring, longer than any step.
    first = np.full(int(2 * _BUCKETS * (rows + columns)), -1, dtype=np.int32)
    queued, after = np.empty(8 * count + 1, dtype=np.int32), np.empty(8 * count + 1, dtype=np.int32)
    corner[goal], length[goal], queued[0], after[0], first[0] = goal, 0.0, goal, -1, 0
    pushed, waiting, bucket = 1, 1, 0
    while waiting > 0:
        while first[bucket % len(first)] < 0:
            bucket += 1
        entry = first[bucket % len(first)]
        first[bucket % len(first)] = after[entry]
        waiting -= 1
        cell = queued[entry]
        if settled[cell]:
            continue
        near, via = _steps(free, cell, neighbors), corner[cell]
        if not _beside_seen(settled, corner, columns, cell) and not _sees(free, cell, via):
            length[cell] = np.inf
            for other in neighbors[:near]:
                if settled[other]:
                    beyond = corner[other]
                    if beyond == via or not _sees(free, cell, beyond):
                        beyond = other
                    way = length[beyond] + _distance(cell, beyond, columns)
                    if way < length[cell]:
                        length[cell], corner[cell] = way, beyond
            via = corner[cell]
        settled[cell] = True
        order[done] = cell
        done += 1
        for other in neighbors[:near]:
            way = length[via] + _distance(other, via, columns)
            if not settled[other] and way < length[other]:
                length[other], corner[other] = way, via
                place = max(int(_BUCKETS * way), bucket) % len(first)
                queued[pushed], after[pushed], first[place] = other, first[place], pushed
                pushed, waiting = pushed + 1, waiting + 1
    return corner, order[:done]


@compiled
def _place(cell: int, columns: int, goal: int, end: complex) -> complex:
    """Return the middle of a cell; of the goal's, its exact place."""
    return end if cell == goal else complex(cell % columns, cell // columns)


@compiled
def _heading(way: complex) -> float:
    return math.atan2(way.imag, way.real)


@compiled
def _turned(before: complex, after: complex) -> float:
    """Return the angle in rad between two directions."""
    return abs(_heading(after * before.conjugate()))


@compiled
def _arrival(here: complex, way: complex, beyond: float, end: complex, look: float) -> float:
    """Return the heading in rad over the last `look` of a route, which is `beyond` long after `way`."""
    share = max(abs(way) + beyond - look, 0.0) / max(abs(way), 1e-9)
    return _heading(end - here - share * way)


@compiled
def _tables(corner: Cells, order: Cells, columns: int, end: complex, room: Table, look: float) -> Tables:
    """Return the tables of a field to the exact place `end`; see `Tables`."""
    length, turn = np.zeros(len(corner), dtype=np.float32), np.zeros(len(corner), dtype=np.float32)
    least, arrival = room.copy(), np.zeros(len(corner), dtype=np.float32)
    goal, bends = order[0], np.zeros(len(corner), dtype=np.bool_)
    for cell in order:
        bends[corner[cell]] = True
    for cell in order[1:]:
        via, here = corner[cell], complex(cell % columns, cell // columns)
        way = _place(via, columns, goal, end) - here
        step = here + way / max(abs(way.real), abs(way.imag), 1.0)
        ahead = int(step.imag + 0.5) * columns + int(step.real + 0.5)
        least[cell] = min(room[cell], least[ahead if corner[ahead] == via else via])
        if bends[cell]:
            length[cell] = length[via] + abs(way)
            arrival[cell] = arrival[via]
            if length[via] < look:
                arrival[cell] = _arrival(here, way, length[via], end, look)
            if via != goal:
                turn[cell] = turn[via] + _turned(way, _place(corner[via], columns, goal, end) - here - way)
    return length, least, turn, arrival


@compiled
def _look_up(
    starts: Places,
    entries: Cells,
    corner: Cells,
    tables: Tables,
    columns: int,
    goal: int,
    end: complex,
    look: float,
) -> FloatArray:
    """Return the routes to `end` from n starts in the cells `entries`, shape (6, n), as in `RouteSet`."""
    length, least, turn, arrival = tables
    found = np.empty((6, len(starts)))
    for at in range(len(starts)):
        here, cell = starts[at], entries[at]
        via = corner[cell]
        there = _place(via, columns, goal, end)
        way = there - here
        found[0, at], found[1, at], found[2, at] = abs(way) + length[via], 0.0, least[cell]
        found[3, at], found[4, at], found[5, at] = _heading(way), _heading(way), via == goal
        if via == goal:
            continue
        after = _place(corner[via], columns, goal, end) - there
        found[1, at], found[4, at] = turn[via] + _turned(way, after), arrival[via]
        if length[via] < look:
            found[4, at] = _arrival(here, way, length[via], end, look)
        left, point = look, here
        while abs(way) < left and via != goal:
            left -= abs(way)
            point, via = there, corner[via]
            there = _place(via, columns, goal, end)
            way = there - point
        found[3, at] = _heading(point + min(left / max(abs(way), 1e-9), 1.0) * way - here)
    return found
