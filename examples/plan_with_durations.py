"""Divide stations among robots: predicted durations are the costs of a planner, here Aries.

    scripts/run python examples/plan_with_durations.py

The service predict_durations answers the same table with `pairs`, see docs/rounds.md.
"""

from __future__ import annotations

from operator import itemgetter

import numpy as np
import unified_planning.shortcuts as up

from ator_ros.actions.base import Goal
from ator_ros.domains.drive import DRIVE
from ator_ros.geometry import FloatArray, Pose
from ator_ros.performance.model_file import load_models
from ator_ros.refinement.step_durations import DurationTable
from ator_ros.tops.chain import TopCall
from ator_ros.world.state import RobotState, World

STARTS = (Pose(-3.0, 1.0, 0.0), Pose(3.0, -1.0, 3.14))  # of the robots, in m and rad
STATIONS = ((-2.0, -1.5), (0.0, 1.5), (0.5, -1.5), (2.0, 0.5), (3.0, 1.8))  # m; any heading
TIME_UNITS = 10.0  # per s: Aries plans with integers


def durations() -> FloatArray:
    """Return the times in s from r starts and s stations to the s stations, shape (r + s, s)."""
    robot = DRIVE.robot()
    library = DRIVE.library(robot)
    models = load_models(robot, DRIVE.known_features, folder=DRIVE.shipped_models)
    worlds = [World(0.0, RobotState(start)) for start in STARTS]
    calls = [
        TopCall(library["goToPose"], Goal(Pose(x, y, 0.0)), frozenset({"yaw"})) for x, y in STATIONS
    ]
    table = DurationTable.of_pairs(worlds, calls, models, robot=robot, ranges=library.ranges)
    return table.whole().durations


def plan(times: FloatArray, seconds: float = 5.0) -> list[list[int]]:
    """Plan within `seconds`, from times as `durations` returns; return each robot's stations."""
    place = up.UserType("place")
    robot = up.UserType("robot")
    at = up.Fluent("at", robot=robot, place=place)
    visited = up.Fluent("visited", place=place)
    time = up.Fluent("time", up.IntType(), start=place, goal=place)
    drive = up.DurativeAction("drive", robot=robot, start=place, goal=place)
    drive.set_fixed_duration(time(drive.start, drive.goal))
    drive.add_condition(up.StartTiming(), at(drive.robot, drive.start))
    drive.add_effect(up.StartTiming(), at(drive.robot, drive.start), False)
    drive.add_effect(up.EndTiming(), at(drive.robot, drive.goal), True)
    drive.add_effect(up.EndTiming(), visited(drive.goal), True)
    problem = up.Problem("stations")
    problem.add_fluent(at, default_initial_value=False)
    problem.add_fluent(visited, default_initial_value=False)
    problem.add_fluent(time, default_initial_value=10**6)  # a start is no goal
    problem.add_action(drive)
    places = [problem.add_object(f"place{number}", place) for number in range(len(times))]
    starts = places[: len(times) - times.shape[1]]
    stations = places[len(starts) :]
    robots = [problem.add_object(f"robot{number}", robot) for number in range(len(starts))]
    for own, start in zip(robots, starts, strict=True):
        problem.set_initial_value(at(own, start), True)
    for (row, column), value in np.ndenumerate(times):
        units = max(1, round(TIME_UNITS * value))
        problem.set_initial_value(time(places[row], stations[column]), units)
    for station in stations:
        problem.add_goal(visited(station))
    problem.add_quality_metric(up.MinimizeMakespan())
    up.get_environment().credits_stream = None
    with up.AnytimePlanner(name="aries") as planner:
        solutions = [each.plan for each in planner.get_solutions(problem, timeout=seconds)]
    best = [found for found in solutions if found][-1]
    drives = [
        step.actual_parameters for _, step, _ in sorted(best.timed_actions, key=itemgetter(0))
    ]
    return [
        [stations.index(goal.object()) for driver, _, goal in drives if driver.object() == own]
        for own in robots
    ]


def main() -> None:
    """Print which robot visits which stations, in order, and when it has visited them."""
    times = durations()
    for number, visits in enumerate(plan(times)):
        rows = [number, *(len(STARTS) + station for station in visits)]
        total = sum(times[row, station] for row, station in zip(rows, visits, strict=False))
        listed = ", ".join(str(STATIONS[station]) for station in visits)
        print(f"robot {number + 1}: {listed or 'no station'}: {total:.1f} s")


if __name__ == "__main__":
    main()
