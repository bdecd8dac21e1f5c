"""Plan which of two robots visits which station, with predicted durations of the drives.

    scripts/run python examples/plan_with_durations.py --problems 20

Planning domains often have `(= ?duration 1)`. Here the learned model predicts the duration of each
drive. The plans of Aries are executed in the simulation, and compared with plans for other
durations.
"""

from __future__ import annotations

import argparse
import itertools
import math
from collections.abc import Sequence
from operator import itemgetter

import numpy as np
import unified_planning.shortcuts as up

from ator_ros.actions.base import Goal
from ator_ros.domains.drive import DRIVE
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.geometry import FloatArray, Pose
from ator_ros.performance.accuracy import mean_ci95
from ator_ros.performance.model_file import load_models
from ator_ros.refinement.step_durations import predict_durations
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.world.state import RobotState, World

ROBOT = DRIVE.robot()
LIBRARY = DRIVE.library(ROBOT)
MODELS = load_models(ROBOT, DRIVE.known_features, folder=DRIVE.shipped_models)
ROBOTS, STATIONS = 2, 5
TIME_UNITS = 10.0  # per s: Aries plans with integers
SPACING = 0.8  # m, between places, and from the edge of the area


def random_places(random: np.random.Generator) -> list[Pose]:
    """Return random poses of the starts, then of the stations, in m and rad."""
    area = ROBOT.scene.area
    half = np.array([area.length / 2.0 - SPACING, area.width / 2.0 - SPACING, math.pi])
    while True:
        places = [Pose(*random.uniform(-half, half).tolist()) for _ in range(ROBOTS + STATIONS)]
        if min(one.distance(other) for one, other in itertools.combinations(places, 2)) > SPACING:
            return places


def durations_between(places: Sequence[Pose]) -> dict[str, FloatArray]:
    """Return three estimates of the durations of drives between n places, in s, shape (n, n)."""
    worlds = [World(0.0, RobotState(pose)) for pose in places]
    calls = [TopCall(LIBRARY["goToPose"], Goal(pose)) for pose in places]
    predicted = predict_durations(worlds, calls, MODELS).durations
    fastest = (
        np.array([[start.distance(goal) for goal in places] for start in places])
        / ROBOT.greatest_speed()
    )
    return {"equal": np.ones_like(predicted), "by distance": fastest, "predicted": predicted}


def plan(durations: FloatArray, seconds: float) -> list[list[int]]:
    """Plan within `seconds` from durations in s, shape (n, n).

    Return the stations of each robot in order.
    """
    robot, place = up.UserType("robot"), up.UserType("place")
    at, visited = up.Fluent("at", robot=robot, place=place), up.Fluent("visited", place=place)
    duration = up.Fluent("duration", up.IntType(), start=place, goal=place)
    drive = up.DurativeAction("drive", robot=robot, start=place, goal=place)
    drive.set_fixed_duration(duration(drive.start, drive.goal))
    drive.add_condition(up.StartTiming(), at(drive.robot, drive.start))
    drive.add_effect(up.StartTiming(), at(drive.robot, drive.start), False)
    for effect in (at(drive.robot, drive.goal), visited(drive.goal)):
        drive.add_effect(up.EndTiming(), effect, True)
    problem = up.Problem("stations")
    for fluent, default in ((at, False), (visited, False), (duration, 1)):
        problem.add_fluent(fluent, default_initial_value=default)
    problem.add_action(drive)
    robots = [problem.add_object(f"robot{number}", robot) for number in range(ROBOTS)]
    places = [problem.add_object(f"place{number}", place) for number in range(len(durations))]
    for number, start in enumerate(robots):
        problem.set_initial_value(at(start, places[number]), True)
    for (start, goal), time in np.ndenumerate(durations):
        problem.set_initial_value(
            duration(places[start], places[goal]), max(1, round(TIME_UNITS * time))
        )
    for station in places[ROBOTS:]:
        problem.add_goal(visited(station))
    problem.add_quality_metric(up.MinimizeMakespan())
    with up.AnytimePlanner(name="aries") as planner:
        best = [
            found.plan for found in planner.get_solutions(problem, timeout=seconds) if found.plan
        ][-1]
    drives = [
        step.actual_parameters for _, step, _ in sorted(best.timed_actions, key=itemgetter(0))
    ]
    goals = [
        [goal.object() for driver, _, goal in drives if driver.object() == robot]
        for robot in robots
    ]
    return [[places.index(goal) for goal in own] for own in goals]


def execute(places: Sequence[Pose], stations_by_robot: Sequence[Sequence[int]]) -> float:
    """Return the time in s until both robots have visited their stations in the simulation."""
    times = [0.0]
    for start, stations in zip(places, stations_by_robot, strict=False):
        if stations:
            calls = tuple(TopCall(LIBRARY["goToPose"], Goal(places[number])) for number in stations)
            run = run_chain(
                ROBOT, LIBRARY, World(0.0, RobotState(start)), TopChain(calls), time_limit=300.0
            )
            times.append(run.duration)
    return max(times)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--problems", type=int, default=20)
    parser.add_argument("--seed", type=int, default=7001)
    parser.add_argument("--seconds", type=float, default=5.0, help="for each plan")
    options = parser.parse_args(arguments)
    up.get_environment().credits_stream = None
    times: dict[str, list[float]] = {}
    for number in range(options.problems):
        places = random_places(np.random.default_rng([options.seed, number]))
        for kind, durations in durations_between(places).items():
            times.setdefault(kind, []).append(execute(places, plan(durations, options.seconds)))
    for kind, makespans in times.items():
        longer = np.subtract(makespans, times["predicted"])
        low, high = mean_ci95(longer)
        change = f"{longer.mean():+.1f} s (95 % CI {low:+.1f} to {high:+.1f} s)"
        print(f"{kind}: {np.mean(makespans):.1f} s; compared with predicted durations: {change}")


if __name__ == "__main__":
    main()
