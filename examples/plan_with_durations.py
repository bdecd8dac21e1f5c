"""Two robots divide stations among themselves, planned with predicted durations of their drives.

    scripts/run python examples/plan_with_durations.py --problems 20

Planning domains often have `(= ?duration 1)`. Here the duration of a drive is a numeric fluent of start and
goal, whose values the learned model predicts. unified-planning describes the problem, Aries solves it, and
the robots drive the plan in the simulation. Plans with equal durations, and with durations proportional to
distance, are driven for comparison.
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
from ator_ros.refinement.durations import predict_durations
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.world.state import RobotState, World

ROBOT = DRIVE.robot()
LIBRARY = DRIVE.library(ROBOT)
MODELS = load_models(ROBOT, DRIVE.known_features, folder=DRIVE.shipped_models)
ROBOTS, STATIONS = 2, 5
TICKS = 10.0  # per s: Aries plans with whole numbers
APART = 0.8  # m, between places, and from the edge


def drawn(random: np.random.Generator) -> list[Pose]:
    """Draw the poses of the starts, then of the stations, in m and rad."""
    area = ROBOT.scene.area
    half = np.array([area.length / 2.0 - APART, area.width / 2.0 - APART, math.pi])
    while True:
        places = [Pose(*random.uniform(-half, half).tolist()) for _ in range(ROBOTS + STATIONS)]
        if min(one.distance(other) for one, other in itertools.combinations(places, 2)) > APART:
            return places


def durations_between(places: Sequence[Pose]) -> dict[str, FloatArray]:
    """Return by kind the durations of drives from each of n places to each other, in s, shape (n, n).

    Those of the kind "equal" are 1.
    """
    worlds = [World(0.0, RobotState(pose)) for pose in places]
    calls = [TopCall(LIBRARY["goToPose"], Goal(pose)) for pose in places]
    far = np.array([[one.distance(other) for other in places] for one in places])
    predicted = predict_durations(worlds, calls, ROBOT, MODELS).durations
    return {"equal": np.ones_like(far), "by distance": far / ROBOT.limits.v, "predicted": predicted}


def planned(durations: FloatArray, seconds: float) -> list[list[int]]:
    """Plan within `seconds` from durations in s, shape (n, n); return the stations of each robot in order."""
    robot, place = up.UserType("robot"), up.UserType("place")
    at, visited = up.Fluent("at", robot=robot, place=place), up.Fluent("visited", place=place)
    duration = up.Fluent("duration", up.IntType(), start=place, goal=place)
    drive = up.DurativeAction("drive", robot=robot, start=place, goal=place)
    drive.set_fixed_duration(duration(drive.start, drive.goal))
    drive.add_condition(up.StartTiming(), at(drive.robot, drive.start))
    drive.add_effect(up.StartTiming(), at(drive.robot, drive.start), False)
    for reached in (at(drive.robot, drive.goal), visited(drive.goal)):
        drive.add_effect(up.EndTiming(), reached, True)
    problem = up.Problem("stations")
    for fluent, usual in ((at, False), (visited, False), (duration, 1)):
        problem.add_fluent(fluent, default_initial_value=usual)
    problem.add_action(drive)
    robots = [problem.add_object(f"robot{number}", robot) for number in range(ROBOTS)]
    places = [problem.add_object(f"place{number}", place) for number in range(len(durations))]
    for number, start in enumerate(robots):
        problem.set_initial_value(at(start, places[number]), True)
    for (start, goal), taken in np.ndenumerate(durations):
        problem.set_initial_value(duration(places[start], places[goal]), max(1, round(TICKS * taken)))
    for station in places[ROBOTS:]:
        problem.add_goal(visited(station))
    problem.add_quality_metric(up.MinimizeMakespan())
    with up.AnytimePlanner(name="aries") as planner:
        plan = [found.plan for found in planner.get_solutions(problem, timeout=seconds) if found.plan][-1]
    steps = [step.actual_parameters for _, step, _ in sorted(plan.timed_actions, key=itemgetter(0))]
    orders = [[str(goal) for who, _, goal in steps if str(who) == str(robot)] for robot in robots]
    return [[int(goal.removeprefix("place")) for goal in order] for order in orders]


def driven(places: Sequence[Pose], plan: Sequence[Sequence[int]]) -> float:
    """Return the time in s until all stations are visited, as both robots drive in simulations."""
    times = [0.0]
    for start, stations in zip(places, plan, strict=False):
        if stations:
            calls = tuple(TopCall(LIBRARY["goToPose"], Goal(places[number])) for number in stations)
            run = run_chain(ROBOT, LIBRARY, World(0.0, RobotState(start)), TopChain(calls), time_limit=300.0)
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
        places = drawn(np.random.default_rng([options.seed, number]))
        for kind, durations in durations_between(places).items():
            times.setdefault(kind, []).append(driven(places, planned(durations, options.seconds)))
    for kind, taken in times.items():
        low, high = mean_ci95(np.subtract(taken, times["predicted"]))
        print(f"{kind}: {np.mean(taken):.1f} s, {low:.1f} to {high:.1f} s longer than with predictions")


if __name__ == "__main__":
    main()
