"""The paper's Figure 6 for our models: the best subgoal from the sum of the models of a chain's actions."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ator_ros.actions import DEFAULT_SET
from ator_ros.actions.base import Goal
from ator_ros.domains.domain import DomainError
from ator_ros.domains.presentation import Models
from ator_ros.domains.soccer.ball import objects_of
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.drawing import BLUE, GREY, ORANGE, draw_robot, new_figure, save_svg
from ator_ros.geometry import FloatArray, Pose
from ator_ros.performance.model_file import ModelFileError, load_models
from ator_ros.refinement.chain_prediction import ChainModel
from ator_ros.refinement.free_variables import analyse, names_of
from ator_ros.refinement.objective import Objective
from ator_ros.robot.description import ConfigError, Robot
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import ObjectState, RobotState, World

# As in the paper's Figure 1: the robot drives away from the goal to get to the ball.
START = Pose(1.5, 0.6, math.pi)
BALL = Pose(-0.5, 0.0, 0.0)
GOAL = Pose(2.2, 0.0, 0.0)
CANDIDATES = 180


def example(library: TopLibrary) -> tuple[World, TopChain]:
    """Return the situation and the chain of the figure."""
    world = World(0.0, RobotState(START), objects_of(ObjectState(BALL.x, BALL.y)))
    first, second = library["goToBall"], library["dribbleBall"]
    return world, TopChain(
        (
            TopCall(first, Goal(BALL, 0.0, first.point), frozenset({"yaw"})),
            TopCall(second, Goal(GOAL, 0.0, second.point)),
        )
    )


def curves(robot: Robot, models: Models, library: TopLibrary) -> tuple[FloatArray, list[FloatArray]]:
    """Return the headings (rad), shape (n,), and the predicted durations (s) of both actions there."""
    world, chain = example(library)
    free = analyse(chain, models, robot).free
    model = ChainModel(world, chain, robot, models=models, names=names_of(chain, free), objective=Objective())
    headings = np.linspace(-math.pi, math.pi, CANDIDATES, endpoint=False)
    nothing = np.zeros((1, 0))
    first = model.step_cost(0, nothing, headings[:, None])
    return headings, [first, model.step_cost(1, headings[:, None], nothing)]


def figure6(robot: Robot, models: Models, library: TopLibrary) -> Any:
    """Draw the two actions' polar plots, their sum, and the situation."""
    headings, (first, second) = curves(robot, models, library)
    total = first + second
    naive, best = int(np.argmin(first)), int(np.argmin(total))
    figure = new_figure(11.0, 6.6)
    titles = ("goToBall (s)", "dribbleBall (s)", "both (s)")
    for column, (title, values) in enumerate(zip(titles, (first, second, total), strict=True)):
        axes = figure.add_subplot(2, 3, column + 1, projection="polar")
        axes.plot(np.append(headings, headings[0]), np.append(values, values[0]), color="black", lw=1.2)
        for index, colour in ((naive, ORANGE), (best, BLUE)):
            axes.plot([headings[index]] * 2, [0.0, values[index]], color=colour, lw=1.5)
            axes.plot(headings[index], values[index], "o", color=colour, ms=4)
        axes.set_title(f"{title}\n{values[naive]:.1f} s alone, {values[best]:.1f} s together", fontsize=9)
        axes.set_ylim(0.0, float(total.max()))
        axes.tick_params(labelsize=7)
    for position, index, name, colour in ((4, naive, "naive", ORANGE), (6, best, "refined", BLUE)):
        _situation(
            figure.add_subplot(2, 3, position), robot, float(headings[index]), name, colour, total[index]
        )
    return figure


def _situation(axes: Any, robot: Robot, heading: float, name: str, colour: str, total: float) -> None:
    draw_robot(axes, robot, START, GREY)
    draw_robot(axes, robot, robot.pose_holding(BALL._replace(yaw=heading)), colour)
    draw_robot(axes, robot, robot.pose_holding(GOAL), GREY)
    axes.plot(BALL.x, BALL.y, "o", color="black", ms=5)
    axes.set_title(f"{name}: {total:.1f} s predicted in all", fontsize=9)
    axes.set_aspect("equal")
    axes.axis("off")


def main(argv: Sequence[str] | None = None) -> int:
    """Draw the figure to a file; return the exit code."""
    parser = argparse.ArgumentParser(prog="figure6", description=__doc__)
    parser.add_argument("--action-set", default=DEFAULT_SET)
    parser.add_argument("--models", default="", metavar="DIR", help="folder of models (default: as shipped)")
    parser.add_argument("--out", type=Path, default=Path("docs/figure6.svg"))
    options = parser.parse_args(argv)
    try:
        robot = SOCCER.robot()
        folder = Path(options.models) if options.models else SOCCER.shipped_models
        models = load_models(robot, SOCCER.known_features, action_set=options.action_set, folder=folder)
        library = SOCCER.library(robot, options.action_set)
    except (ConfigError, DomainError, ModelFileError) as error:
        print(f"figure6: {error}", file=sys.stderr)
        return 1
    save_svg(figure6(robot, models, library), options.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
