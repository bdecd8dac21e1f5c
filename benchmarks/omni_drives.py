"""How reliable and how fast the drives of omnidirectional robots are.

scripts/run python benchmarks/omni_drives.py

Situations of `goToPose` in the domain `drive` are executed in the simulation. Their durations are
compared with a bound that no motion of the robot is below: the translation along the line, that
across it, and the turn, each alone, at the greatest speed and acceleration that the robot has in
any direction. The true optimum is between both, so the printed ratios are upper bounds. The last
column has the time that plans and predictions without drives use.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Sequence
from functools import partial

import numpy as np

from ator_ros.actions.situation import Situation
from ator_ros.bases.description import load_robot
from ator_ros.bases.differential.durations import Rates, drive_time
from ator_ros.bases.direct import direct_table
from ator_ros.bases.omni.omni_robot import OmniRobot, omnidirectional
from ator_ros.domains.drive import DRIVE, tops_for
from ator_ros.experience.parallel import progress, run_tasks, workers
from ator_ros.experience.simulated import episode_generator, run_episode
from ator_ros.geometry import FloatArray, Pose, wrap_angle
from ator_ros.resources import resource_path
from ator_ros.simulation.scene_simulation import Simulation
from ator_ros.tops.library import top_of

ROBOTS = ("omni_soccer", "mecanum")
PAIRS = 10_000  # of which times are measured


def shipped(name: str) -> OmniRobot:
    """Return the robot of a shipped description."""
    return omnidirectional(load_robot(resource_path("config", f"{name}.yaml")))


def bound(robot: OmniRobot, situation: Situation) -> float:
    """Return a time in s that no motion of the robot is below."""
    limits = robot.limits
    v = max(limits.v, limits.backward, limits.sideways)
    a = max(limits.a, limits.brake, limits.side_change)
    start = situation.robot
    goal = situation.goal
    x = goal.pose.x - start.pose.x
    y = goal.pose.y - start.pose.y
    line = math.atan2(y, x)
    velocity = Pose(0.0, 0.0, start.pose.yaw - line).compose(Pose(start.vx, start.vy, 0.0))
    end = Pose(0.0, 0.0, goal.pose.yaw - line).compose(Pose(goal.speed, 0.0, 0.0))
    rates = Rates(v, 1.0, a, a, 1.0)
    turning = Rates(limits.w, 1.0, limits.aw, limits.aw, 1.0)
    turn = wrap_angle(goal.pose.yaw - start.pose.yaw)
    turns = (turn, turn - math.copysign(2.0 * math.pi, turn))
    return max(
        float(drive_time(math.hypot(x, y), velocity.x, end.x, rates)),
        float(drive_time(0.0, velocity.y, end.y, rates)),
        min(float(drive_time(angle, start.w, 0.0, turning)) for angle in turns),
    )


def measured(number: int, *, name: str, seed: int) -> tuple[bool, float, float, float, str]:
    """Return success, duration, bound and predicted time (s) of a situation, and the reason."""
    robot = shipped(name)
    spec = DRIVE.actions()["goToPose"]
    situation = spec.situation(robot, episode_generator(spec.name, seed, number))
    with Simulation(robot) as simulation:
        top = top_of(situation, tops_for(robot), robot)
        episode = run_episode(simulation, spec.factory(robot), situation, top=top)
    predicted = float(robot.fastest(legs_of([situation]), None)[0, 0])
    return episode.success, episode.duration, bound(robot, situation), predicted, episode.reason


def legs_of(situations: Sequence[Situation]) -> FloatArray:
    """Return the direct variables of situations as a table."""
    states = [each.robot for each in situations]
    goals = [each.goal for each in situations]
    return direct_table(
        {
            "x": [state.pose.x for state in states],
            "y": [state.pose.y for state in states],
            "yaw": [state.pose.yaw for state in states],
            "v": [state.vx for state in states],
            "w": [state.w for state in states],
            "vy": [state.vy for state in states],
            "xg": [goal.pose.x for goal in goals],
            "yg": [goal.pose.y for goal in goals],
            "yawg": [goal.pose.yaw for goal in goals],
            "speedg": [goal.speed for goal in goals],
            "hold": 0.0,
        }
    ).table


def microseconds(name: str, seed: int) -> float:
    """Return the time in us of one pair in a search."""
    robot = shipped(name)
    spec = DRIVE.actions()["goToPose"]
    rng = np.random.default_rng(seed)
    legs = legs_of([spec.situation(robot, rng) for _ in range(100)])
    many = np.tile(legs, PAIRS // 100)
    robot.fastest(many, None)
    start = time.perf_counter()
    robot.fastest(many, None)
    seconds = time.perf_counter() - start
    return float(1e6 * seconds / PAIRS)


def row(name: str, situations: int, seed: int) -> str:
    """Return the row of a robot in Markdown; prints failures."""
    run = partial(measured, name=name, seed=seed)
    with workers(-1):
        tasks = run_tasks(run, range(situations))
        found = list(progress(tasks, done=0, total=situations, unit="situation"))
    for success, *_, reason in found:
        if not success:
            print(f"{name}: {reason}")
    good = np.array([numbers[1:4] for numbers in found if numbers[0]])
    share = len(good) / situations
    duration, least, _ = good.mean(axis=0)
    error = np.abs(good[:, 2] - good[:, 0]).mean() / duration
    return (
        f"| {name} | {share:.1%} | {duration:.2f} s | {duration / least:.3f} | {error:.1%} | "
        f"{microseconds(name, seed):.1f} µs |"
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="omni_drives",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--situations", type=int, default=300)
    parser.add_argument("--seed", type=int, default=901)
    options = parser.parse_args(argv)
    print("| robot | success | duration | ratio to the bound | error without drives | one pair |")
    print("| --- | --- | --- | --- | --- | --- |")
    for name in ROBOTS:
        print(row(name, options.situations, options.seed))
    return 0


if __name__ == "__main__":
    sys.exit(main())
