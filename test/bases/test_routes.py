"""Routes on a map: lengths, headings, clearances, places without a route."""

import dataclasses
import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from maps import hall, hall_map

from ator_ros.bases.description import load_robot
from ator_ros.bases.routes import CLEARANCES, Routes, RouteSet, routes_of
from ator_ros.files import FileError
from ator_ros.geometry import FloatArray, Pose, wrap_angles
from ator_ros.world.grid_map import GridMap, PlannerBusyError

RADIUS = 0.2
GRID = hall_map()
ROUTES = Routes(GRID, RADIUS)


def between(*pairs: tuple[float, float, float, float], routes: Routes = ROUTES) -> RouteSet:
    return routes.between(*np.array(pairs, dtype=float).T)


def test_each_thread_has_routes_of_its_own() -> None:
    # a learned set is loaded in a thread while requests are answered
    robot = dataclasses.replace(load_robot(), grid=GRID)
    with ThreadPoolExecutor(1) as threads:
        other, again = (threads.submit(routes_of, robot).result() for _ in range(2))
    assert routes_of(robot) is routes_of(robot) is not other
    assert other is again


def test_a_free_line_is_the_route() -> None:
    found = between((-5.0, -3.0, -1.0, 1.0), (1.0, 1.0, 5.0, 1.0))
    assert found.straight.all()
    assert found.length == pytest.approx([math.hypot(4.0, 4.0), 4.0])
    assert found.departure == pytest.approx([math.pi / 4, 0.0])
    assert found.arrival == pytest.approx(found.departure)
    assert found.turn == pytest.approx(0.0)


def test_a_route_leads_through_the_door_around_its_corners() -> None:
    found = between((-3.0, 0.0, 3.0, 0.0))
    # It is a tangent to circles around the corners of the wall, at x = 0.1 m and y = 2 m.
    near = RADIUS + CLEARANCES[0]
    angle = math.atan2(2.0, 2.9) + math.asin(near / math.hypot(2.0, 2.9))
    length = 2.0 * (math.sqrt(2.0**2 + 2.9**2 - near**2) + near * angle) + 0.2
    assert found.length == pytest.approx(length, abs=0.1)
    assert found.departure == pytest.approx(angle, abs=0.1)
    assert found.arrival == pytest.approx(-angle, abs=0.1)
    assert found.turn == pytest.approx(2.0 * angle, abs=0.2)
    assert found.clearance == pytest.approx(near, abs=0.1)
    assert not found.straight


def test_a_planner_replaces_the_search_and_is_asked_once_for_each_pair_of_places() -> None:
    asked = []

    def planner(start: tuple[float, float], goal: tuple[float, float]) -> FloatArray | None:
        asked.append((start, goal))
        corner = (0.0, 2.4)  # its steps are those of cells
        path = np.concatenate([np.linspace(start, corner, 60), np.linspace(corner, goal, 60)])
        return np.round(path / 0.05) * 0.05 if goal[1] > -3.0 else None

    routes = Routes(dataclasses.replace(GRID, planner=planner), RADIUS)
    pairs = [(-3.0, 0.0, 3.0, 0.0), (-3.0, 0.0, 3.0, -3.5), (-3.0, 2.4, 3.0, 2.4)]
    for _ in range(2):
        found = between(*pairs, *pairs, routes=routes)
    assert set(asked) == {(pair[:2], pair[2:]) for pair in pairs}
    assert len(asked) == 2 + 2  # the pair without a path is asked for in each call
    none = np.empty(0)
    assert routes.between(none, none, none, none).length.size == 0
    angle = math.atan2(2.4, 3.0)
    assert found.length[0] == pytest.approx(2.0 * math.hypot(3.0, 2.4), rel=0.1)
    assert found.departure[0] == pytest.approx(angle, abs=0.15)
    assert found.arrival[0] == pytest.approx(-angle, abs=0.15)
    assert found.turn[0] == pytest.approx(2.0 * angle, abs=0.3)
    assert found.clearance[0] == pytest.approx(0.4, abs=0.15)
    assert np.isnan(found.length[1])
    assert found.straight.tolist() == [False, False, True] * 2


def test_while_its_planner_is_busy_routes_are_searched_and_it_is_asked_again_later() -> None:
    is_busy = True

    def planner(start: tuple[float, float], goal: tuple[float, float]) -> FloatArray | None:
        if is_busy:
            raise PlannerBusyError
        return np.array([start, (0.0, 2.4), goal])

    routes = Routes(dataclasses.replace(GRID, planner=planner), RADIUS)
    pair = (-3.0, 0.0, 3.0, 0.0)
    for searched, expected in zip(between(pair, routes=routes), between(pair), strict=True):
        assert searched == pytest.approx(expected)
    assert routes.corners(pair[:2], pair[2:]) == pytest.approx(ROUTES.corners(pair[:2], pair[2:]))
    is_busy = False
    assert between(pair, routes=routes).length == pytest.approx(2.0 * math.hypot(3.0, 2.4))
    assert len(routes.corners(pair[:2], pair[2:])) == 3


def test_many_starts_one_goal_and_the_reverse() -> None:
    rng = np.random.default_rng(1)
    x, y = rng.uniform((-5.5, -3.5), (5.5, 3.5), (300, 2)).T
    open_floor = np.abs(x) > 0.5
    x, y = x[open_floor], y[open_floor]
    there = ROUTES.between(x, y, np.full(len(x), 3.0), np.full(len(x), -1.0))
    back = ROUTES.between(np.full(len(x), 3.0), np.full(len(x), -1.0), x, y)
    assert np.isfinite(there.length).all()
    assert back.length == pytest.approx(there.length)
    assert np.abs(wrap_angles(back.departure - there.arrival - math.pi)).max() < 1e-6
    single = [between((a, b, 3.0, -1.0)).length[0] for a, b in zip(x[:20], y[:20], strict=True)]
    assert single == pytest.approx(there.length[:20])
    assert (there.length > np.hypot(x - 3.0, y + 1.0) - 1e-6).all()


@pytest.mark.parametrize("yaw", [0.7, -2.5])
def test_a_turned_map_has_the_same_routes(yaw: float) -> None:
    frame = Pose(2.0, -1.0, yaw)
    turned = Routes(dataclasses.replace(GRID, origin=frame.compose(GRID.origin)), RADIUS)
    start, goal = (frame.compose(Pose(x, 0.5, 0.0)) for x in (-3.0, 3.0))
    found, usual = between((*start[:2], *goal[:2]), routes=turned), between((-3.0, 0.5, 3.0, 0.5))
    assert found.length == pytest.approx(usual.length, abs=1e-4)
    assert wrap_angles(found.departure - usual.departure) == pytest.approx(yaw, abs=1e-4)


def test_places_without_a_route_are_reported() -> None:
    closed = hall()
    closed[:, 118:122] = False
    routes = Routes(GridMap("closed", closed, 0.05, GRID.origin), RADIUS)
    pairs = [
        (-3.0, 0.0, 3.0, 0.0),
        (-3.0, 0.0, 0.0, 0.0),
        (-3.0, 0.0, 30.0, 0.0),
        (-3.0, 0.0, -2.0, 0.0),
    ]
    assert np.isnan(between(*pairs, routes=routes).length).tolist() == [True, True, True, False]
    assert routes.fault(-2.0, 0.0, (-3.0, 0.0)) is None
    assert "in reach of x -3.00 m, y 0.00 m, on the map closed" in (
        routes.fault(3.0, 0.0, (-3.0, 0.0)) or ""
    )
    wanted = f"in free space, 0.20 m from obstacles, on the map {routes.grid}, got x"
    assert all(wanted in (routes.fault(x, 0.0) or "") for x in (0.0, 30.0))


@pytest.mark.parametrize("width", [10, 12, 16, 24])
def test_a_door_is_passed_if_the_robot_fits(width: int) -> None:
    free = hall()
    free[:, 118:122] = False
    free[60 : 60 + width, 118:122] = True
    found = between(
        (-3.0, 0.0, 3.0, 0.0), routes=Routes(GridMap("door", free, 0.05, GRID.origin), RADIUS)
    )
    assert np.isfinite(found.length) == (width * 0.05 > 2.0 * RADIUS)


def walled(wall: slice, *, side: int = 1600, door: bool = False) -> GridMap:
    """Return a square map of cells of 5 cm, with a wall across, and a door at its far end."""
    free = np.ones((side, side), dtype=bool)
    free[: side - 30 if door else side, wall] = False
    return GridMap("large", free, 0.05, Pose(0.0, 0.0, 0.0))


@pytest.mark.parametrize("wall", [slice(800, 801), slice(802, 803), slice(803, 805)])
def test_a_thin_wall_separates_on_a_large_map(wall: slice) -> None:
    closed = Routes(walled(wall), 0.13)
    assert np.isnan(between((38.0, 5.0, 42.0, 5.0), routes=closed).length[0])


def test_routes_lead_to_the_far_door_of_a_large_map() -> None:
    routes = Routes(walled(slice(803, 804), door=True), 0.13)
    far, near = (38.0, 5.0, 42.0, 5.0), (38.0, 5.0, 36.0, 8.0)
    found = between(far, near, routes=routes)
    around = 2.0 * math.hypot(2.0, 78.5 + 0.13 + CLEARANCES[0] - 5.0)
    assert found.length == pytest.approx([around, math.hypot(2.0, 3.0)], abs=1.0)
    assert found.length[1] == pytest.approx(between(near, routes=routes).length[0])


@pytest.mark.parametrize("resolution", [0.02, 0.05, 0.2])
@pytest.mark.parametrize("radius", [0.05, 0.13, RADIUS])
@pytest.mark.parametrize("angle", [0.0, 0.3, math.pi / 4, 1.3])
def test_a_wall_of_one_cell_separates_any_robot_and_a_door_of_its_width_does_not(
    resolution: float, radius: float, angle: float
) -> None:
    side = 121
    middles = np.arange(side) - 60.0
    x, y = np.meshgrid(middles, middles)
    # One cell in each row or column, whichever of them the line crosses at a steeper angle.
    size = max(abs(math.cos(angle)), abs(math.sin(angle)))
    across = (y * math.cos(angle) - x * math.sin(angle)) / size
    along = x * math.cos(angle) + y * math.sin(angle)
    wall = (across > -0.5) & (across <= 0.5)
    grids = [
        GridMap(name, ~blocked, resolution, Pose(0.0, 0.0, 0.0))
        for name, blocked in (
            ("closed", wall),
            ("open", wall & (np.abs(along) > radius / resolution + 0.75)),
        )
    ]
    closed, passable = (Routes(grid, radius) for grid in grids)
    rng = np.random.default_rng(0)
    starts = rng.uniform(0.0, side, (200, 2))
    starts[:100] = starts[:100] * 0.02 + 59.0  # next to the wall
    rows, columns = starts[:, 1].astype(int), starts[:, 0].astype(int)
    above = across[rows, columns] > 0.5
    below = across[rows, columns] <= -0.5
    places = resolution * starts
    pairs = np.concatenate([places[above][:40], places[below][:40]], axis=1).T
    assert not closed.connected(pairs).any()
    middle = 0.5 * side * resolution
    there = 40.0 * resolution * np.array([-math.sin(angle), math.cos(angle)])
    through = middle - there[0], middle - there[1], middle + there[0], middle + there[1]
    assert np.isfinite(between(through, routes=passable).length[0])


def test_a_map_too_large_for_the_robot_is_rejected() -> None:
    with pytest.raises(FileError, match=r"large: expected at most 16 million cells of 0\.1 m"):
        Routes(walled(slice(0, 1), side=9000), RADIUS)


def test_a_map_without_room_for_the_robot_is_rejected() -> None:
    with pytest.raises(FileError, match=r"hall: expected a place 9 m from obstacles, got none"):
        Routes(GRID, 9.0)


def length_of(corners: FloatArray) -> float:
    return float(np.hypot(*np.diff(corners, axis=0).T).sum())


def test_the_corners_of_a_route_are_its_bends() -> None:
    """The hall has a wall in its middle, around which each route from side to side leads."""
    rng = np.random.default_rng(3)
    for _ in range(10):
        start = (float(rng.uniform(-5.0, -1.0)), float(rng.uniform(-3.0, 3.0)))
        goal = (float(rng.uniform(1.0, 5.0)), float(rng.uniform(-3.0, 3.0)))
        route = between((*start, *goal))
        corners = ROUTES.corners(start, goal)
        assert corners[0] == pytest.approx(start)
        assert corners[-1] == pytest.approx(goal)
        assert length_of(corners) == pytest.approx(route.length[0], rel=1e-5)
        assert (len(corners) == 2) == route.straight[0]
        first = corners[1] - corners[0]
        if np.hypot(*first) > 0.5:
            assert math.atan2(first[1], first[0]) == pytest.approx(route.departure[0], abs=1e-6)
    assert ROUTES.corners((-3.0, 0.0), (50.0, 0.0)).tolist() == [[-3.0, 0.0], [50.0, 0.0]]


def test_the_corners_of_a_planned_route_are_the_places_of_its_path() -> None:
    bend = (0.0, 3.0)
    routes = Routes(
        dataclasses.replace(GRID, planner=lambda start, goal: np.array([start, bend, goal])), RADIUS
    )
    found = routes.corners((-3.0, 0.0), (3.0, 0.0))
    assert found == pytest.approx(np.array([(-3.0, 0.0), bend, (3.0, 0.0)]))
