"""Gain against how awkward the paper's dribbleBall is: chains at several limits of its rotation.

A kinematic sketch, for speed: wheels follow commands with a lag, the ball lies where the robot's front is.
    scripts/run python benchmarks/bezier_awkwardness.py
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ator_ros.domains.soccer import situations
from ator_ros.domains.soccer.bezier.dribble_ball import HANDLE, ROTATION, dribbling
from ator_ros.domains.soccer.bezier.driver import Driver, Style, reached, standing_place
from ator_ros.domains.soccer.bezier.go_to_pose import TO_BALL
from ator_ros.domains.soccer.chains import CHAINS
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.files import portable_command, write_text
from ator_ros.geometry import FloatArray, Pose, wrap_angle
from ator_ros.performance.tree.model_tree import ModelTreeRegressor
from ator_ros.robot.description import Limits, Robot, load_robot
from ator_ros.world.state import CONTROL_PERIOD as PERIOD
from ator_ros.world.state import Command, RobotState

LIMIT = 40.0  # s
HEADINGS = 12
ROTATIONS = (1.2, 0.9, 0.7, 0.6, 0.5, 0.45)  # rad/s
HANDLES = (0.2, 0.3)  # m, at the shipped rotation


def duration(limits: Limits, style: Style, start: Pose, target: Pose, *, turns: bool) -> float:
    """Return the time in s from rest at `start` to `target`; `turns`: it may end by turning on the spot."""
    driver = Driver(limits, style)
    state, lag = RobotState(start), 1.0 - math.exp(-PERIOD / 0.03)
    for tick in range(round(LIMIT / PERIOD)):
        rel = target.relative(state.pose)
        if reached(rel, state.v, 0.0):
            return tick * PERIOD
        on_the_spot = turns and standing_place(rel)
        command = driver.turn(-rel.yaw) if on_the_spot else driver.follow(state, target, 0.0)
        state = _moved(state, command, lag)
    return LIMIT


def _moved(state: RobotState, command: Command, lag: float) -> RobotState:
    v, w = state.v + lag * (command.v - state.v), state.w + lag * (command.w - state.w)
    way = (0.5 * (state.v + v)) * PERIOD
    middle = Pose(state.pose.x, state.pose.y, state.pose.yaw + 0.25 * (state.w + w) * PERIOD).ahead(way)
    yaw = wrap_angle(state.pose.yaw + 0.5 * (state.w + w) * PERIOD)
    return RobotState(Pose(middle.x, middle.y, yaw), v, w)


def features(start: Pose, target: Pose) -> tuple[float, float, float]:
    """Return the paper's three features: dist (m), angle_to_dest and angle_at_dest (rad)."""
    line = math.atan2(target.y - start.y, target.x - start.x)
    return start.distance(target), abs(wrap_angle(line - start.yaw)), abs(wrap_angle(target.yaw - line))


Drive = Callable[[Pose, Pose], float]


def learned(
    robot: Robot, action: str, drive: Drive, episodes: int, fresh: int
) -> tuple[ModelTreeRegressor, str, float]:
    """Return a model tree of a drive's duration, its MAE / RMSE on fresh starts, and their mean (s)."""
    rng = np.random.default_rng(751)
    rows, times = [], []
    while len(rows) < episodes + fresh:
        drawn = getattr(situations, action)(robot, rng)
        if not drawn.objects:
            continue
        target = dataclasses.replace(drawn.goal, speed=0.0).robot_pose(robot)
        rows.append(features(drawn.robot.pose, target))
        times.append(drive(drawn.robot.pose, target))
    table, seconds = np.array(rows), np.array(times)
    tree = ModelTreeRegressor(smoothing=60.0)
    tree.fit(table[:episodes], seconds[:episodes], groups=np.arange(episodes))
    error = tree.predict(table[episodes:]) - seconds[episodes:]
    accuracy = f"{np.abs(error).mean():.2f} / {math.sqrt((error**2).mean()):.2f}"
    return tree, accuracy, float(seconds.mean())


def headings(robot: Robot, count: int) -> list[tuple[Pose, list[Pose], Pose]]:
    """Return the start, the poses at the ball with `HEADINGS` headings, and the goal of each situation."""
    library, found = SOCCER.library(robot, "bezier"), []
    for index in range(count):
        world, chain = CHAINS["dribble"](robot, library, np.random.default_rng((752, index)))
        ball, start = chain.calls[0].goal.pose, world.robot.pose
        line = math.atan2(ball.y - start.y, ball.x - start.x)
        yaws = (wrap_angle(line + 2.0 * math.pi * k / HEADINGS) for k in range(HEADINGS))
        poses = [robot.pose_holding(ball._replace(yaw=yaw)) for yaw in yaws]
        found.append((start, poses, chain.calls[1].goal.robot_pose(robot)))
    return found


def predicted(tree: ModelTreeRegressor, pairs: Sequence[tuple[Pose, Pose]]) -> FloatArray:
    """Return the predicted durations in s of drives from pose to pose."""
    return np.asarray(tree.predict(np.array([features(*pair) for pair in pairs])))


def row(
    robot: Robot,
    style: Style,
    first: tuple[ModelTreeRegressor, FloatArray],
    trials: Sequence[tuple[Pose, list[Pose], Pose]],
    episodes: int,
) -> str:
    """Return gains of refined headings and of the oracle with one style of dribbling, as cells of a table."""

    def dribble(start: Pose, target: Pose) -> float:
        return duration(robot.holder_for("dribbleBall").limits, style, start, target, turns=False)

    tree, accuracy, mean = learned(robot, "dribble_ball", dribble, episodes, episodes)
    sums = {"naive": 0.0, "refined": 0.0, "oracle": 0.0}
    slower = 0
    for (start, poses, goal), approach in zip(trials, first[1], strict=True):
        total = approach + np.array([dribble(pose, goal) for pose in poses])
        alone = predicted(first[0], [(start, pose) for pose in poses])
        both = alone + predicted(tree, [(pose, goal) for pose in poses])
        naive, refined = total[np.argmin(alone)], total[np.argmin(both)]
        slower += bool(refined > 1.02 * naive)
        for name, time in (("naive", naive), ("refined", refined), ("oracle", total.min())):
            sums[name] += float(time)
    gains = {name: 100.0 * (1.0 - time / sums["naive"]) for name, time in sums.items()}
    return (
        f"{mean:.2f} s | {accuracy} | {sums['naive'] / len(trials):.2f} s | {gains['refined']:.1f} % "
        f"| {gains['oracle']:.1f} % | {100.0 * slower / len(trials):.0f} % |"
    )


def main() -> None:
    """Print and write the table."""
    parser = argparse.ArgumentParser(prog="bezier_awkwardness", description=__doc__)
    parser.add_argument("--situations", type=int, default=100)
    parser.add_argument("--episodes", type=int, default=300, help="to learn from, and as many fresh ones")
    parser.add_argument("--out", type=Path, default=Path("docs/awkwardness_bezier.md"))
    options = parser.parse_args()
    robot = load_robot()
    trials = headings(robot, options.situations)

    def approach(start: Pose, target: Pose) -> float:
        return duration(robot.limits, TO_BALL, start, target, turns=True)

    tree, accuracy, mean = learned(robot, "go_to_pose", approach, options.episodes, options.episodes)
    times = np.array([[approach(start, pose) for pose in poses] for start, poses, _ in trials])
    styles = [(HANDLE, rotation) for rotation in ROTATIONS] + [(handle, ROTATION) for handle in HANDLES]
    rows = [
        f"| {rotation:g} rad/s | {handle:g} m | "
        + row(robot, dribbling(handle, rotation), (tree, times), trials, options.episodes)
        for handle, rotation in styles
    ]
    lines = [
        "# Gain against awkwardness of dribbleBall (set `bezier`)",
        "",
        f"Made by `{portable_command('bezier_awkwardness', sys.argv[1:])}`: kinematics without physics,",
        f"{options.situations} situations, {HEADINGS} headings, the paper's 3 features, {options.episodes}",
        f"episodes to learn from. goToPose: mean {mean:.2f} s, MAE / RMSE {accuracy} s.",
        "",
        "| rotation | handle | dribbleBall, mean | MAE / RMSE (s) | naive | refined | oracle | slower |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
        *rows,
    ]
    text = "\n".join(lines) + "\n"
    write_text(options.out, text)
    print(text)


if __name__ == "__main__":
    main()
