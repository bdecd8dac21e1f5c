"""Gain against how awkward the paper's dribbleBall is: chains at several limits of its rotation.

A kinematic sketch, for speed: wheels follow commands with a lag, the ball lies where the robot's front is.
    scripts/run python benchmarks/bezier_awkwardness.py
Writes the table, and the curve of both gains against the rotation beside it (.svg).
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ator_ros.domains.soccer import situations
from ator_ros.domains.soccer.bezier.dribble_ball import HANDLE, ROTATION, STRAIGHTENING, dribbling
from ator_ros.domains.soccer.bezier.driver import Driver, Style, reached, standing_place
from ator_ros.domains.soccer.bezier.go_to_pose import TO_BALL
from ator_ros.domains.soccer.chains import CHAINS
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.drawing import BLUE, ORANGE, new_figure, save_svg
from ator_ros.experience.parallel import run_tasks
from ator_ros.files import portable_command, write_text
from ator_ros.geometry import FloatArray, Pose, wrap_angle
from ator_ros.performance.tree.model_tree import ModelTreeRegressor
from ator_ros.robot.description import Limits, Robot
from ator_ros.world.state import CONTROL_PERIOD as PERIOD
from ator_ros.world.state import Command, RobotState

LIMIT = 40.0  # s
HEADINGS = 12
ROTATIONS = (1.2, 0.9, 0.7, 0.6, 0.5, 0.45, 0.4)  # rad/s
HANDLES = (0.2, 0.3)  # m, at the shipped rotation


def duration(limits: Limits, style: Style, start: Pose, target: Pose, *, turns: float) -> float:
    """Return the time in s from rest at `start` to `target`, where it may turn on the spot by `turns` rad."""
    driver = Driver(limits, style)
    state, lag = RobotState(start), 1.0 - math.exp(-PERIOD / 0.03)
    for tick in range(round(LIMIT / PERIOD)):
        rel = target.relative(state.pose)
        if reached(rel, state.v, 0.0):
            return tick * PERIOD
        on_the_spot = standing_place(rel) and abs(rel.yaw) <= turns
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


class Row(NamedTuple):
    """What one style of dribbling leaves to gain: rotation (rad/s), handle (m), times (s), gains (%)."""

    rotation: float
    handle: float
    mean: float
    accuracy: str
    naive: float
    refined: float
    oracle: float
    slower: float

    def cells(self) -> str:
        """Return the row of the table."""
        return (
            f"| {self.rotation:g} rad/s | {self.handle:g} m | {self.mean:.2f} s | {self.accuracy} "
            f"| {self.naive:.2f} s | {self.refined:.1f} % | {self.oracle:.1f} % | {self.slower:.0f} % |"
        )


class Sketch:
    """The chains, with the approaches to all headings driven and learned once for all styles of dribbling."""

    def __init__(self, robot: Robot, count: int, episodes: int) -> None:
        self._robot, self._episodes = robot, episodes
        self._trials = headings(self._robot, count)

        def approach(start: Pose, target: Pose) -> float:
            return duration(self._robot.limits, TO_BALL, start, target, turns=math.pi)

        self._tree, self.accuracy, self.mean = learned(
            self._robot, "go_to_pose", approach, episodes, episodes
        )
        self._times = np.array(
            [[approach(start, pose) for pose in poses] for start, poses, _ in self._trials]
        )

    def row(self, style: tuple[float, float]) -> Row:
        """Return gains of refined headings and of the oracle with one handle (m) and rotation (rad/s)."""
        handle, rotation = style

        def dribble(start: Pose, target: Pose) -> float:
            limits = self._robot.holder_for("dribbleBall").limits
            return duration(limits, dribbling(handle, rotation), start, target, turns=STRAIGHTENING)

        tree, accuracy, mean = learned(self._robot, "dribble_ball", dribble, self._episodes, self._episodes)
        sums = np.zeros(3)  # s: naive, refined, oracle
        slower = 0
        for (start, poses, goal), approach in zip(self._trials, self._times, strict=True):
            total = approach + np.array([dribble(pose, goal) for pose in poses])
            alone = predicted(self._tree, [(start, pose) for pose in poses])
            both = alone + predicted(tree, [(pose, goal) for pose in poses])
            naive, refined = total[np.argmin(alone)], total[np.argmin(both)]
            slower += bool(refined > 1.02 * naive)
            sums += (naive, refined, total.min())
        count = len(self._trials)
        _, by_refined, by_oracle = 100.0 * (1.0 - sums / sums[0])
        return Row(
            rotation, handle, mean, accuracy, sums[0] / count, by_refined, by_oracle, 100.0 * slower / count
        )


def chart(rows: Sequence[Row]) -> Any:
    """Draw what refined headings and the oracle save against the rotation, with the shipped handles."""
    shipped = [row for row in rows if row.handle == HANDLE]
    figure = new_figure(4.5, 3.2)
    axes = figure.add_subplot()
    for name, colour in (("oracle", ORANGE), ("refined", BLUE)):
        values = [getattr(row, name) for row in shipped]
        axes.plot([row.rotation for row in shipped], values, color=colour, marker="o", ms=3, label=name)
    axes.axhline(12.0, color="0.5", lw=0.8, ls="--")
    axes.text(shipped[0].rotation, 12.2, "the paper's 12 %", ha="right", fontsize=8)
    axes.set_xlabel("greatest rotation with the ball, rad/s")
    axes.set_ylabel("gain over naive, %")
    axes.legend(frameon=False)
    return figure


def main() -> None:
    """Print and write the table, and draw the curve."""
    parser = argparse.ArgumentParser(prog="bezier_awkwardness", description=__doc__)
    parser.add_argument("--situations", type=int, default=100)
    parser.add_argument("--episodes", type=int, default=300, help="to learn from, and as many fresh ones")
    parser.add_argument("--jobs", type=int, default=-1)
    parser.add_argument("--out", type=Path, default=Path("docs/awkwardness_bezier.md"))
    options = parser.parse_args()
    sketch = Sketch(SOCCER.robot(), options.situations, options.episodes)
    styles = [(HANDLE, rotation) for rotation in ROTATIONS] + [(handle, ROTATION) for handle in HANDLES]
    rows = list(run_tasks(sketch.row, styles, jobs=options.jobs))
    lines = [
        "# Gain against awkwardness of dribbleBall (set `bezier`)",
        "",
        f"Made by `{portable_command('bezier_awkwardness', sys.argv[1:])}`: kinematics without physics,",
        f"{options.situations} situations, {HEADINGS} headings, the paper's 3 features, {options.episodes}",
        f"episodes to learn from. goToPose: mean {sketch.mean:.2f} s, MAE / RMSE {sketch.accuracy} s.",
        "",
        "| rotation | handle | dribbleBall, mean | MAE / RMSE (s) | naive | refined | oracle | slower |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
        *(row.cells() for row in rows),
    ]
    text = "\n".join(lines) + "\n"
    write_text(options.out, text)
    save_svg(chart(rows), options.out.with_suffix(".svg"))
    print(text)


if __name__ == "__main__":
    main()
