"""Soccer in reports: the field, the words, and the paper's numbers and figures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ator_ros.domains.presentation import Captioned, Line, Models, Presentation
from ator_ros.performance.model import PerformanceModel
from ator_ros.robot.description import Robot
from ator_ros.tops.library import TopLibrary

_GREY = "#8a8f98"  # as in `ator_ros.drawing`, which needs matplotlib
_CENTRE_CIRCLE = 1.0  # m


def draw_field(axes: Any, robot: Robot) -> None:
    """Draw the lines around the field."""
    x_min, y_min, x_max, y_max = robot.scene.area.lines
    axes.plot((x_min, x_max, x_max, x_min, x_min), (y_min, y_min, y_max, y_max, y_min), color=_GREY, lw=0.8)


def field_lines(robot: Robot) -> Sequence[Line]:
    """Return the halfway line and the centre circle."""
    area, corners = robot.scene.area, np.linspace(0.0, 2.0 * np.pi, 49)
    _, y_min, _, y_max = area.lines
    x, y = area.x + _CENTRE_CIRCLE * np.cos(corners), area.y + _CENTRE_CIRCLE * np.sin(corners)
    return [(area.x, y_min), (area.x, y_max)], list(zip(x.tolist(), y.tolist(), strict=True))


def paper_figures(robot: Robot, models: Models, library: TopLibrary) -> Sequence[Captioned]:
    """Return the paper's figures 4 and 6 for learned models; without a holder, Figure 4 to a pose."""
    from ator_ros.domains.soccer.figures.figure4 import (
        figure4,  # nodes, which know soccer, need no matplotlib
    )
    from ator_ros.domains.soccer.figures.figure6 import figure6

    go_to_pose = models["goToPose"]
    assert isinstance(go_to_pose, PerformanceModel)
    alone = (
        figure4(go_to_pose, hold=robot.holder is not None),
        "Figure 4: predicted time of goToPose against the angle at the destination, 2 m straight ahead.",
    )
    if robot.holder is None:
        return (alone,)
    together = (
        figure6(robot, models, library),
        "Figure 6: the subgoal from the sum of the models. Orange: fastest alone; blue: together.",
    )
    return alone, together


PRESENTATION = Presentation(
    draw=draw_field,
    lines=field_lines,
    place="ball",
    chains={
        "dribble": "go to the ball, dribble it to a pose",
        "drive": "go to a place, go on to a pose",
        "rolling": "go to a ball that rolls, dribble it to a pose",
        "shoot": "go to the ball, dribble it, shoot",
    },
    policies={"face_goal": "ball between robot and goal, as most teams approach"},
    published={"goToPose": "0.31 / 0.75", "dribbleBall": "0.29 / 0.73"},
    table1=(
        ("Before filtering, paper: runs", "1000", "533", "369", "98"),
        ("Before filtering, paper: improvement", "10%", "21%", "0%", "-10%"),
        ("After filtering, paper: runs", "1000", "505", "485", "10"),
        ("After filtering, paper: improvement", "12%", "23%", "0%", "-6%"),
    ),
    title="Figures 4 and 6 of the paper, for our models",
    figures=paper_figures,
)
