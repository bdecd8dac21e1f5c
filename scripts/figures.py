"""Draw the paper's Figures 4 and 6 for learned models of soccer.

scripts/run python scripts/figures.py --action-set bezier    # figure[46]_bezier.svg
"""

from __future__ import annotations

import argparse
import io
import math
import sys
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from ator_ros.actions import DEFAULT_SET
from ator_ros.actions.base import Goal
from ator_ros.bases.description import Robot
from ator_ros.domains.domain import find_domain
from ator_ros.domains.soccer.field import objects_of
from ator_ros.files import write_text
from ator_ros.geometry import FloatArray, Pose
from ator_ros.performance.features import feature_table
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.model_file import load_models
from ator_ros.refinement.chain_prediction import ChainModel
from ator_ros.refinement.free_variables import analyze, names_of
from ator_ros.refinement.objective import Objective
from ator_ros.tools.demo import ORANGE
from ator_ros.tools.floor_plan import BLUE, GRAY
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import ObjectState, RobotState, World

SOCCER = find_domain("soccer")
DISTANCE = 2.0  # m to the ball straight ahead, in Figure 4
STEP = math.radians(0.5)  # rad between angles in Figure 4
EXAMPLE = math.radians(45.0)  # the angle whose rule is printed
# Figure 6, as Figure 1: the robot drives away from the goal to reach the ball.
START = Pose(1.5, 0.6, math.pi)
BALL = Pose(-0.5, 0.0, 0.0)
GOAL = Pose(2.2, 0.0, 0.0)
CANDIDATES = 180  # headings in Figure 6
_STYLE: Any = {
    "font.family": "DejaVu Sans",
    "svg.fonttype": "none",
    "svg.hashsalt": "ator_ros",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e3e5e8",
    "axes.axisbelow": True,
    "font.size": 9,
}


def new_figure(width: float, height: float) -> Any:
    """Return an empty figure of this size in inches."""
    mpl.rcParams.update(_STYLE)
    return Figure(figsize=(width, height), layout="constrained")


def draw_robot(
    axes: Any,
    robot: Robot,
    pose: Pose,
    color: str,
) -> None:
    """Draw the robot's outline at `pose`, with a line to its front."""
    front = robot.front
    rear = -robot.rear
    half = robot.half_width
    corners = ((front, half), (front, -half), (rear, -half), (rear, half))
    outline = np.array([pose.compose(Pose(x, y, 0.0))[:2] for x, y in corners])
    axes.fill(
        outline[:, 0],
        outline[:, 1],
        facecolor=color,
        edgecolor="none",
        alpha=0.2,
    )
    axes.plot(
        *np.append(outline, outline[:1], axis=0).T,
        color=color,
        lw=1.0,
        alpha=0.85,
    )
    tip = pose.ahead(robot.front)
    axes.plot(
        [pose.x, tip.x],
        [pose.y, tip.y],
        color=color,
        lw=1.6,
        alpha=0.85,
    )


def situations(robot: Robot, angles: FloatArray) -> dict[str, Any]:
    """Return the direct variables of starts at rest before a ball.

    `angles` are the headings at the ball in rad, shape (n,).
    """
    return {
        **dict.fromkeys(("x", "y", "yaw", "v", "w", "speedg"), 0.0),
        "xg": DISTANCE + robot.hold * np.cos(angles),
        "yg": robot.hold * np.sin(angles),
        "yawg": angles,
        "hold": 1.0,
    }


def figure4(model: PerformanceModel) -> Any:
    """Draw the predicted time against the angle at the ball, the limits of leaves, and one rule.

    It is Figure 4 of the paper.
    """
    angles = np.arange(-math.pi, math.pi + STEP / 2, STEP)
    direct = situations(model.robot, angles)
    prediction = model.predict(direct)
    tree = model.trees["duration"]
    features = [model.features[name] for name in tree.names]
    leaves = tree.apply(feature_table(direct, model.robot, features, model.driving))
    changes = np.flatnonzero(np.diff(leaves)) + 1
    times = np.asarray(prediction.duration)
    spread = prediction.spread
    degrees = np.degrees(angles)
    figure = new_figure(8.0, 4.6)
    upper, lower = figure.subfigures(2, 1, height_ratios=(5.0, 1.6))
    axes = upper.add_subplot(1, 2, 1)
    axes.fill_between(
        degrees,
        times - spread,
        times + spread,
        color=BLUE,
        alpha=0.15,
        lw=0,
    )
    for begin, end in zip([0, *changes], [*changes, len(angles)], strict=True):
        axes.plot(
            degrees[begin:end],
            times[begin:end],
            color=BLUE,
            lw=1.5,
        )
    axes.axvline(math.degrees(EXAMPLE), color=GRAY, lw=0.8)
    axes.set(
        xlabel="angle_at_dest (degree)", ylabel="predicted execution time (s)", xlim=(-180, 180)
    )
    axes.set_xticks(range(-180, 181, 60))
    axes.set_ylim(bottom=0.0)
    polar = upper.add_subplot(1, 2, 2, projection="polar")
    polar.plot(angles, times, color=BLUE, lw=1.5)
    for change in changes:
        axes.axvline(
            (degrees[change - 1] + degrees[change]) / 2,
            color=ORANGE,
            lw=0.6,
            ls=":",
        )
        polar.plot(
            [angles[change]] * 2,
            [0.0, float(times.max())],
            color=ORANGE,
            lw=0.6,
            ls=":",
        )
    polar.set_rlim(0.0, float(times.max()) * 1.08)
    polar.tick_params(labelsize=7)
    rule = model.explain(situations(model.robot, np.array([EXAMPLE]))).splitlines()[0]
    lower.text(
        0.02, 0.9, f"rule at {math.degrees(EXAMPLE):.0f}°:", fontsize=7, va="top", color=GRAY
    )
    lower.text(
        0.02,
        0.72,
        textwrap.fill(rule, 118),
        fontsize=6.5,
        va="top",
        family="DejaVu Sans Mono",
    )
    figure.suptitle(
        f"{model.action} to the ball: dist = {DISTANCE:g} m, angle_to_dest = 0°", fontsize=10
    )
    return figure


def example(library: TopLibrary) -> tuple[World, TopChain]:
    """Return situation and chain of Figure 6."""
    world = World(
        0.0,
        RobotState(START),
        objects_of(ObjectState(BALL.x, BALL.y)),
    )
    first = library["goToBall"]
    second = library["dribbleBall"]
    return world, TopChain(
        (
            TopCall(first, Goal(BALL, 0.0, first.point), frozenset({"yaw"})),
            TopCall(second, Goal(GOAL, 0.0, second.point)),
        )
    )


def curves(
    robot: Robot, models: Mapping[str, Any], library: TopLibrary
) -> tuple[FloatArray, list[FloatArray]]:
    """Return headings (rad), and the predicted durations (s) of both actions for them.

    All arrays have the shape (n,).
    """
    world, chain = example(library)
    free = analyze(chain, models, robot).free
    model = ChainModel(
        world,
        chain,
        robot,
        models=models,
        names=names_of(chain, free),
        objective=Objective(),
    )
    headings = np.linspace(-math.pi, math.pi, CANDIDATES, endpoint=False)
    nothing = np.zeros((1, 0))
    steps = (0, nothing, headings[:, None]), (1, headings[:, None], nothing)
    return headings, model.step_costs(steps)


def figure6(
    robot: Robot,
    models: Mapping[str, Any],
    library: TopLibrary,
) -> Any:
    """Draw the times of two actions and their sum against the heading at the ball (Figure 6).

    Below are the naive and the refined choice.
    """
    headings, (first, second) = curves(robot, models, library)
    total = first + second
    naive = int(np.argmin(first))
    best = int(np.argmin(total))
    figure = new_figure(11.0, 6.6)
    titles = ("goToBall (s)", "dribbleBall (s)", "both (s)")
    for column, (title, values) in enumerate(
        zip(titles, (first, second, total), strict=True), start=1
    ):
        axes = figure.add_subplot(2, 3, column, projection="polar")
        axes.plot(
            np.append(headings, headings[0]),
            np.append(values, values[0]),
            color="black",
            lw=1.2,
        )
        for index, color in ((naive, ORANGE), (best, BLUE)):
            axes.plot(
                [headings[index]] * 2,
                [0.0, values[index]],
                color=color,
                lw=1.5,
            )
            axes.plot(
                headings[index],
                values[index],
                "o",
                color=color,
                ms=4,
            )
        axes.set_title(
            f"{title}\n{values[naive]:.1f} s alone, {values[best]:.1f} s together", fontsize=9
        )
        axes.set_ylim(0.0, float(total.max()))
        axes.tick_params(labelsize=7)
    for position, index, name, color in ((4, naive, "naive", ORANGE), (6, best, "refined", BLUE)):
        axes = figure.add_subplot(2, 3, position)
        draw_robot(axes, robot, START, GRAY)
        at_ball = BALL._replace(yaw=float(headings[index]))
        draw_robot(axes, robot, robot.pose_holding(at_ball), color)
        draw_robot(axes, robot, robot.pose_holding(GOAL), GRAY)
        axes.plot(BALL.x, BALL.y, "o", color="black", ms=5)
        axes.set_title(f"{name}: {total[index]:.1f} s predicted in all", fontsize=9)
        axes.set_aspect("equal")
        axes.axis("off")
    return figure


def save_svg(figure: Any, path: Path) -> None:
    """Write the figure as an SVG file, without its date."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    write_text(path, '<?xml version="1.0" encoding="utf-8"?>\n' + text[text.index("<svg") :])


def main(argv: Sequence[str] | None = None) -> int:
    """Write both figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--action-set", default=DEFAULT_SET)
    parser.add_argument("--models", type=Path, default=SOCCER.shipped_models, metavar="DIR")
    parser.add_argument("--out", type=Path, default=Path("docs"), metavar="DIR")
    options = parser.parse_args(argv)
    robot = SOCCER.robot()
    suffix = "" if options.action_set == DEFAULT_SET else f"_{options.action_set}"
    models = load_models(
        robot, SOCCER.known_features, action_set=options.action_set, folder=options.models
    )
    save_svg(figure4(models["goToPose"]), options.out / f"figure4{suffix}.svg")
    library = SOCCER.library(robot, options.action_set)
    save_svg(figure6(robot, models, library), options.out / f"figure6{suffix}.svg")
    return 0


if __name__ == "__main__":
    sys.exit(main())
