"""The search for paths: each takes the stated time, and the chosen ones are nearly the fastest."""

import math

import numpy as np
import pytest
from robots import OTHERS, PIONEER, PLAIN

from ator_ros.bases.description import Robot
from ator_ros.bases.differential.driving import free_shapes, plain_driving
from ator_ros.bases.differential.durations import change_distance, rates_of, turn_time
from ator_ros.bases.differential.limits import Limits
from ator_ros.bases.differential.manoeuvre import Manoeuvre, Side, close
from ator_ros.bases.differential.paths import Ends, entries_of, exits_of, find_paths
from ator_ros.bases.differential.shapes import Rules, drawn_ends, fastest_paths, shape_set
from ator_ros.bases.differential.trajectory import Trajectory
from ator_ros.geometry import FloatArray, Pose, Records

START = Pose(0.5, -1.0, 2.0)
every_robot = pytest.mark.parametrize("robot", [PIONEER, OTHERS[-1]], ids=lambda robot: robot.name)


def ends(limits: Limits, speed: float) -> tuple[Ends, Ends]:
    """Return turns at once, and turns before a straight run, with several changes of speed."""
    changes = [share * min(limits.a, limits.brake) for share in (-0.7, 0.0, 0.4, 1.0)]
    begins = [Side(0.0, speed, speed, change, limits.w) for change in changes]
    runs = [Side(0.2, 0.1, 0.3 * limits.v, change, 0.8 * limits.w) for change in changes]
    return entries_of(begins, limits), exits_of(runs, limits)


def speed_after(sides: Records, turns: FloatArray, limits: Limits) -> FloatArray:
    """Return the speeds in m/s at the inner ends of turns in rad."""
    times = turn_time(turns, sides["rate"], limits.aw)
    return np.clip(sides["speed"] + sides["change"] * times, -limits.v, limits.v)


def goals(count: int) -> list[Pose]:
    rng = np.random.default_rng(4)
    return [
        Pose(*map(float, rng.uniform((-3.0, -2.0, -math.pi), (3.0, 2.0, math.pi))))
        for _ in range(count)
    ]


@every_robot
def test_each_path_leads_to_its_goal_in_the_stated_time(robot: Robot) -> None:
    limits = robot.limits
    entries, exits = ends(limits, 0.4 * limits.v)
    off = []
    for goal in goals(20):
        paths = find_paths(START, goal, entries, exits, limits, most=10)
        assert (np.diff(paths["time"]) >= 0.0).all()
        for time, entry, exit_, first, last, drive in paths.tolist():
            rows = entries.sides[entry], exits.sides[exit_]
            first, last, drive, met = close(first, last, START, goal, *rows, rates_of(limits))
            assert met
            sides = (Side(*row.tolist()) for row in rows)
            plan = Manoeuvre(START, goal, *sides, first, last, drive, limits)
            off.append(abs(plan.duration - time))
            trajectory = Trajectory(plan)
            before = trajectory.at(trajectory.duration - 1e-9).pose
            assert before.distance(goal) < 1e-3
            assert abs(before.relative(goal).yaw) < 1e-3
    assert np.median(off) < 1e-3
    assert np.percentile(off, 95) < 0.02


def test_paths_are_forward_and_within_a_time_if_requested() -> None:
    limits = PIONEER.limits
    entries, exits = ends(limits, 0.0)
    for goal in goals(20):
        free = find_paths(START, goal, entries, exits, limits)
        bound = float(np.median(free["time"]))
        kept = find_paths(START, goal, entries, exits, limits, longest=bound)
        assert kept.tolist() == free[free["time"] <= bound].tolist()
        forward = find_paths(START, goal, entries, exits, limits, forward=True)
        before = speed_after(entries.sides[free["entry"]], free["first"], limits)
        after = speed_after(exits.sides[free["exit"]], free["last"], limits)
        suffices = free["drive"] >= change_distance(before, after, limits)
        drives_forward = set(free["time"][suffices & (before >= 0.0) & (after >= 0.0)])
        assert set() < drives_forward <= set(forward["time"]) <= set(free["time"][suffices])
        few = find_paths(START, goal, entries, exits, limits, most=7)
        assert few.tolist() == free[:7].tolist()


@pytest.mark.parametrize("robot", [PIONEER, PLAIN, OTHERS[-1]], ids=lambda robot: robot.name)
def test_chosen_paths_are_nearly_as_fast_as_all_of_the_grid(robot: Robot) -> None:
    limits = robot.limits
    grid = shape_set([[shape] for shape in free_shapes(limits)], Rules(rates_of(limits)))
    chosen = plain_driving(robot.limits).drive_paths
    far = np.array([[3.0, 1.0], [0.0, 0.0], [0.0, 0.0], [0.0, limits.v], [limits.v, 0.0]])
    drawn = drawn_ends(far, 150, np.random.default_rng(1))
    mine, best = (fastest_paths(drawn, some, hold=robot.hold)[0] for some in (chosen, grid))
    assert np.isfinite(mine).all()
    assert float(np.mean(mine) / np.mean(np.minimum(mine, best))) < 1.02
