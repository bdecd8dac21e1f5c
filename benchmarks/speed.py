"""Measure the speed of refinement, plans, actions, routes and simulation, without ROS.

The machine must be idle.

make bench                                         # everything
make bench ARGS='refinement --requests 50'
"""

from __future__ import annotations

import argparse
import dataclasses
import gc
import itertools
import math
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from ator_ros.actions.base import Action, ActionError, Goal, Point, Status
from ator_ros.actions.goal_variables import ORDER
from ator_ros.bases.description import Robot
from ator_ros.bases.routes import Routes
from ator_ros.domains.domain import find_domain
from ator_ros.domains.soccer.field import BALL, ball_of, field_of, objects_of
from ator_ros.domains.trials import open_places, open_speeds, random_trial
from ator_ros.evaluation.toolset import ToolsetSource, tools_of
from ator_ros.geometry import BoolArray, FloatArray, Pose
from ator_ros.performance.model import PerformanceModel
from ator_ros.planning.planner import chains_for
from ator_ros.refinement.refiner import LONGEST_CHAIN, Refiner
from ator_ros.refinement.step_durations import DurationTable
from ator_ros.simulation.scene_simulation import CONTROL_RATE, Simulation
from ator_ros.tops.chain import EVERYTHING, TopCall, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.objects import is_lost, kept, object_fetched_by
from ator_ros.world.grid_map import GridMap
from ator_ros.world.state import CONTROL_PERIOD, STOP, Command, ObjectState, RobotState, World

Rows = Iterator[tuple[str, str]]
"""What was measured, and the numbers."""
SOURCE = ToolsetSource()
WARM_UP = 10  # requests
LENGTHS = (2, 8, 32)  # steps of long chains
# stations of rounds in an open order, and the CPU time in ms in which they should be refined
STATIONS = {6: 60, 9: 250, 12: 1000, 30: 3000}
TICKS = 40  # measured ticks of an action: the first two seconds, in which it plans
BLOCK = 5.0  # s of a simulation
ROOMS = 10  # along a side of the building
ROOM = 5.0  # m, side of a room
DOOR = 1.0  # m, width
WALL = 0.15  # m, thickness

CASES: dict[str, tuple[int, Callable[[TopChain], TopChain]]] = {
    "2 steps, heading": (0, lambda chain: chain),
    "2 steps, heading and speed": (0, open_speeds),
    "3 steps, two headings": (-1, lambda chain: chain),
    "3 steps, two headings and speeds": (-1, open_speeds),
    "3 steps, place, headings and speeds": (-1, open_places),
}
"""By name: the domain's first (0) or last (-1) chain, and a function that opens its variables."""


def refinement(requests: int) -> Rows:
    """Measure search, prediction and gate in random situations."""
    tools, library = tools_of(SOURCE)
    refiner = tools.refiner(gated=True)
    names = list(tools.domain.chains)
    gc.collect()
    gc.freeze()
    for name, (kind, opened) in CASES.items():
        times = []
        for index in range(requests + WARM_UP):
            trial = random_trial(
                tools.domain,
                names[kind],
                library,
                seed=801,
                index=index,
            )
            chain = refiner.naive(trial.world, opened(trial.chain))
            began = time.perf_counter()
            refiner.refine(trial.world, chain)
            times.append(time.perf_counter() - began)
        yield f"refinement, {name}", _percentiles(times[WARM_UP:])
    for length in LENGTHS:
        world, chain = long_chain(library, length)
        times = []
        for _ in range(5):
            began = time.perf_counter()
            refiner.refine(world, chain)
            times.append(time.perf_counter() - began)
        yield f"refinement, {length} steps, all open", f"least {1000.0 * min(times):.1f} ms"
    gc.unfreeze()


def ordering(requests: int) -> Rows:
    """Measure the CPU time of the search for order and headings in a hall without walls."""
    tools, library = tools_of(ToolsetSource(domain="drive"))
    refiner = tools.refiner(gated=True)
    for stations in (*STATIONS, LONGEST_CHAIN):
        times = []
        for index in range(max(3, requests // stations)):
            world, chain = random_round(library, stations, seed=index)
            times.append(_cpu_time(refiner, world, chain))
        median = 1000.0 * statistics.median(times)
        allowed = f" of {STATIONS[stations]} ms" if stations in STATIONS else ""
        yield f"round of {stations} stations", f"p50 {median:.0f} ms{allowed}"


def ordering_on_map(requests: int) -> Rows:
    """Measure the same in a building, at a first request with new places and at a second one."""
    tools, library = tools_of(ToolsetSource(domain="building"))
    refiner = tools.refiner(gated=True)
    for stations, limit in STATIONS.items():
        times: dict[str, list[float]] = {"new": [], "known": []}
        for index in range(max(3, requests // (10 * stations))):
            first = index * stations
            trials = [
                random_trial(tools.domain, "round", library, seed=805, index=first + number)
                for number in range(stations)
            ]
            opened = frozenset({"yaw", ORDER})
            calls = (dataclasses.replace(trial.chain.calls[0], open=opened) for trial in trials)
            chain = TopChain(tuple(calls))
            for measured in times.values():
                measured.append(_cpu_time(refiner, trials[0].world, chain))
        for kind, measured in times.items():
            median = 1000.0 * statistics.median(measured)
            allowed = f" of {limit} ms" if kind == "known" else ""
            name = f"round of {stations} stations in a building, {kind} places"
            yield name, f"p50 {median:.0f} ms{allowed}"


def pairs_on_map(requests: int) -> Rows:
    """Measure the table of pairs of new places in a building, without the planner's own time."""
    tools, library = tools_of(ToolsetSource(domain="building"))
    assert tools.robot.grid is not None
    find_path = tools.robot.grid.planner
    assert find_path is not None
    spent = []

    def planner(*ends: tuple[float, float]) -> FloatArray | None:
        began = time.perf_counter()
        path = find_path(*ends)
        spent.append(time.perf_counter() - began)
        return path

    grid = dataclasses.replace(tools.robot.grid, planner=planner)
    robot = dataclasses.replace(tools.robot, grid=grid)
    refiner = tools.refiner(gated=True)
    models = {
        name: dataclasses.replace(model, robot=robot)
        for name, model in refiner.models.items()
        if isinstance(model, PerformanceModel)
    }
    for stations in (6, 30):
        others = []
        for index in range(max(3, requests // (10 * stations))):
            first = 1000 + index * stations
            trials = [
                random_trial(tools.domain, "round", library, seed=806, index=first + number)
                for number in range(stations)
            ]
            opened = frozenset({"yaw"})
            calls = [dataclasses.replace(trial.chain.calls[0], open=opened) for trial in trials]
            spent.clear()
            began = time.perf_counter()
            DurationTable.of_pairs(
                [trials[0].world], calls, models, robot=robot, ranges=refiner.ranges
            ).whole()
            others.append(time.perf_counter() - began - math.fsum(spent))
        name = f"table of {stations} stations, {len(spent)} new paths"
        yield name, f"p50 {1000.0 * statistics.median(others):.0f} ms besides the paths"


def _cpu_time(refiner: Refiner, world: World, chain: TopChain) -> float:
    """Return the CPU time in s of the refinement of a chain."""
    began = time.process_time()
    refiner.refine(world, chain, placeholders=True)
    return time.process_time() - began


def random_round(library: TopLibrary, stations: int, seed: int) -> tuple[World, TopChain]:
    """Draw a start and stations with open order and headings."""
    rng = np.random.default_rng(seed)
    top = next(iter(library.usable()))
    places = rng.uniform(-4.0, 4.0, (stations, 2)).tolist()
    opened = frozenset({"yaw", ORDER})
    calls = tuple(TopCall(top, library.goal(top, Pose(x, y, 0.0)), opened) for x, y in places)
    return World(0.0, RobotState(Pose(0.0, 0.0, 0.0))), TopChain(calls)


def long_chain(library: TopLibrary, steps: int) -> tuple[World, TopChain]:
    """Return a start and a chain of an even number of `steps` that fetch and carry an object."""
    fetching = next(top for top in library.usable() if object_fetched_by(top))
    carrying = next(top for top in library.usable() if kept(top))
    places = [Pose(0.1 * ((step + 1) // 2), 0.0, 0.3) for step in range(steps)]
    calls = [
        TopCall(top, Goal(place, 0.0, top.point), frozenset({EVERYTHING}))
        for top, place in zip([fetching, carrying] * (steps // 2), places, strict=True)
    ]
    there = {str(object_fetched_by(fetching)): ObjectState(0.0, 0.0)}
    return World(0.0, RobotState(Pose(-2.0, 0.0, 0.0)), there), TopChain(tuple(calls))


def plans(requests: int) -> Rows:
    """Measure the planning of chains for each named goal of the domain."""
    tools, library = tools_of(SOURCE)
    domain = tools.domain
    chain = next(iter(domain.chains))
    for name, goal in sorted(domain.goals(tools.robot).items()):
        times = []
        for index in range(requests + WARM_UP):
            world = random_trial(domain, chain, library, seed=803, index=index).world
            began = time.perf_counter()
            chains_for(goal.terms, world, library, domain.objects)
            times.append(time.perf_counter() - began)
        yield f"plans, {name}", _percentiles(times[WARM_UP:])


def ticks(requests: int) -> Rows:
    """Measure the longest tick of actions where a path is hard to find or missing."""
    domain = find_domain(SOURCE.domain)
    robot = SOURCE.described()
    for action_set in domain.action_sets:
        actions = domain.actions(action_set)
        longest = []
        for name, world, goal in hard_situations(robot, requests + WARM_UP, seed=17):
            action = actions[name].factory(robot)
            longest.append(max(tick_times(action, world, goal)))
        yield f"longest tick, {action_set}", _percentiles(longest[WARM_UP:])


def tick_times(
    action: Action,
    world: World,
    goal: Goal,
) -> list[float]:
    """Return the processor time in s of each tick of an action; the robot follows all commands."""
    began = time.process_time()
    times = []
    try:
        action.start(world, goal)
    except ActionError:
        return [time.process_time() - began]
    for _ in range(TICKS):
        step = action.step(world)
        times.append(time.process_time() - began)
        if step.status is not Status.RUNNING:
            break
        world = _after(action.robot, world, step.command or STOP)
        began = time.process_time()
    action.end("measured")
    return times


def hard_situations(
    robot: Robot,
    count: int,
    seed: int,
) -> Iterator[tuple[str, World, Goal]]:
    """Draw situations with posts, walls or the ball in the way: action, start and goal."""
    rng = np.random.default_rng(seed)
    field = field_of(robot)
    x_min, y_min, x_max, y_max = robot.scene.area.floor
    edges = ((x_min, x_max), (y_min, y_max), (-math.pi, math.pi))

    def anywhere() -> Pose:
        return Pose(*(float(rng.uniform(*low_high)) for low_high in edges))

    def near_either_side(at: float) -> float:
        return float(rng.choice((-1.0, 1.0)) * at + rng.normal(0.0, 0.35))

    def at_post() -> Pose:
        post = field.length / 2, field.goal_width / 2
        x, y = (near_either_side(at) for at in post)
        return robot.scene.area.at(x, y, anywhere().yaw)

    def state(pose: Pose) -> RobotState:
        moves = float(rng.random() < 0.5)
        v, w = (moves * float(rng.uniform(-axis.limit, axis.limit)) for axis in robot.axes)
        return RobotState(pose, v, w)

    for index in range(count):
        kind = index % 4
        if kind == 0:  # the ball at a post
            ball = at_post()
            start = state(anywhere())
            rolling = ObjectState(
                ball.x,
                ball.y,
                float(rng.normal()),
                0.0,
            )
            world = World(0.0, start, {BALL: rolling})
            yield "goToPose", world, Goal(ball, 0.0, Point.HOLD)
        elif kind == 1:  # the ball beside the robot, itself at a post or not
            pose = at_post() if rng.random() < 0.5 else anywhere()
            ball = pose.ahead(float(rng.uniform(0.2, 0.8)))
            start = state(pose)
            rolling = ObjectState(
                ball.x,
                ball.y,
                0.0,
                float(rng.normal()),
            )
            world = World(0.0, start, {BALL: rolling})
            yield "goToPose", world, Goal(anywhere())
        else:  # the ball held, somewhere or at a post
            pose = at_post() if rng.random() < 0.5 else anywhere()
            ball = robot.hold_point(pose)
            v = float(rng.integers(2) * rng.uniform(0.0, robot.greatest_speed(holding=True)))
            world = World(
                0.0,
                RobotState(pose, v),
                {BALL: ObjectState(ball.x, ball.y)},
            )
            side = 1 if rng.random() < 0.5 else -1
            mouth = Goal(
                Pose(*field.goal_center(side), 0.0),
                0.0,
                Point.HOLD,
            )
            post = Goal(at_post(), 0.0, Point.HOLD)
            yield ("shoot", world, mouth) if kind == 2 else ("dribbleBall", world, post)


def _after(robot: Robot, world: World, command: Command) -> World:
    """Return the world one tick later; a ball in front of the robot stays there."""
    ball = ball_of(world)
    state = robot.moved(world.robot, command, CONTROL_PERIOD)
    if ball is not None and not is_lost(world, robot, BALL):
        hold = robot.hold_point(state.pose)
        ball = ObjectState(hold.x, hold.y)
    return World(world.time + CONTROL_PERIOD, state, objects_of(ball))


def route(requests: int) -> Rows:
    """Measure the search for routes in a building, from random places to new and known ones."""
    rng = np.random.default_rng(23)
    side = ROOMS * ROOM
    cell = 0.05
    grid = GridMap(
        "building",
        building(rng, cell),
        cell,
        Pose(0.0, 0.0, 0.0),
    )
    routes = Routes(grid, SOURCE.described().half_width)
    times: dict[str, list[float]] = {"new": [], "known": []}
    for _ in range(requests + WARM_UP):
        goal = _in_a_room(rng)
        for kind, measured in times.items():
            ends = np.concatenate([_in_a_room(rng), goal])[:, None]
            began = time.perf_counter()
            found = routes.between(*ends)
            measured.append(time.perf_counter() - began)
            if math.isnan(found.length[0]):
                raise ValueError(
                    f"expected a route to each {kind} place, got none for {ends.ravel()}"
                )
    for kind, measured in times.items():
        name = f"route to a {kind} place, {side:g} x {side:g} m at {100.0 * cell:g} cm"
        yield name, _percentiles(measured[WARM_UP:])


def building(rng: np.random.Generator, cell: float) -> BoolArray:
    """Return the free cells of a square building of rooms; `cell` is their side in m.

    Walls between rooms have a door somewhere.
    """
    room, door, wall = (round(length / cell) for length in (ROOM, DOOR, WALL))
    free = np.ones((ROOMS * room, ROOMS * room), dtype=bool)
    for walls in (free, free.T):
        for edge in range(room, ROOMS * room, room):
            walls[edge : edge + wall] = False
            for first in range(0, ROOMS * room, room):
                begin = first + int(rng.integers(2 * wall, room - door - wall))
                walls[edge : edge + wall, begin : begin + door] = True
    return free


def _in_a_room(rng: np.random.Generator) -> FloatArray:
    """Return x, y in m of a place in any room, away from its walls."""
    return ROOM * (rng.integers(ROOMS, size=2) + rng.uniform(0.2, 0.8, size=2))


def simulation(requests: int) -> Rows:
    """Measure the real-time factor of the simulation in the fastest of several blocks."""
    domain = find_domain(SOURCE.domain)
    robot = SOURCE.described()
    for name, held in (("with a held object", domain.objects[0]), ("without objects", None)):
        least = min(_block(robot, held) for _ in range(min(requests, 12)))
        yield f"simulation, {name}", f"{BLOCK / least:.0f} times real time"


def _block(robot: Robot, held: str | None) -> float:
    """Return the real time in s for a block in which the robot drives in bends.

    `held` is the name of an object that it pushes; None: without an object.
    """
    with Simulation(robot) as simulated:
        simulated.place_robot(Pose(0.0, 0.0, 0.0))
        if held is not None:
            place = robot.hold_point(Pose(0.0, 0.0, 0.0))
            simulated.place_object(held, place.x, place.y)
        bends = itertools.cycle(
            [Command(0.6, 0.3)] * CONTROL_RATE + [Command(0.6, -0.3)] * CONTROL_RATE
        )
        began = time.perf_counter()
        for command in itertools.islice(bends, round(BLOCK * CONTROL_RATE)):
            simulated.command(command)
            simulated.tick()
            simulated.world()
        return time.perf_counter() - began


def _percentiles(times: Sequence[float]) -> str:
    p99 = float(np.quantile(times, 0.99))
    return f"p50 {1000.0 * statistics.median(times):.2f} ms, p99 {1000.0 * p99:.2f} ms"


PARTS: dict[str, Callable[[int], Rows]] = {
    "refinement": refinement,
    "round": ordering,
    "building": ordering_on_map,
    "pairs": pairs_on_map,
    "plans": plans,
    "ticks": ticks,
    "route": route,
    "simulation": simulation,
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)} (default: all)"
    )
    parser.add_argument(
        "--requests", type=int, default=200, metavar="N", help="default: %(default)s"
    )
    options = parser.parse_args(argv)
    if unknown := set(options.parts) - set(PARTS):
        parser.error(f"PART: expected one of {', '.join(PARTS)}, got {', '.join(sorted(unknown))}")
    for part in options.parts or PARTS:
        for case, numbers in PARTS[part](options.requests):
            print(f"{case:50} {numbers}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
