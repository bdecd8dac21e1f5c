"""The paper's Figure 4 for a learned model: predicted time against the angle at the destination."""

from __future__ import annotations

import argparse
import math
import sys
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.drawing import BLUE, GREY, ORANGE, new_figure, save_svg
from ator_ros.geometry import FloatArray
from ator_ros.performance.features import feature_table
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.model_file import ModelFileError, load_model, model_path
from ator_ros.resources import resource_path
from ator_ros.robot.description import ConfigError, Robot

DISTANCE = 2.0  # m, with angle_to_dest 0: the paper's situation
STEP = math.radians(0.5)
EXAMPLE = math.radians(45.0)  # the angle whose rule is printed


def situations(robot: Robot, angles: FloatArray, *, hold: bool) -> dict[str, Any]:
    """Return the direct variables of starts at rest, 2 m straight before the destination.

    Parameters
    ----------
    robot : Robot
        Says how far before the robot's axle a held ball lies.
    angles : ndarray, shape (n,)
        Headings at the destination in rad, seen from the start.
    hold : bool
        Whether a ball waits there.
    """
    ahead = robot.hold if hold else 0.0
    return {
        **dict.fromkeys(("x", "y", "yaw", "v", "w", "speedg"), 0.0),
        "xg": DISTANCE + ahead * np.cos(angles),
        "yg": ahead * np.sin(angles),
        "yawg": angles,
        "hold": float(hold),
    }


def figure4(model: PerformanceModel, *, hold: bool = True) -> Any:
    """Draw the predicted time in Cartesian and polar coordinates, leaves marked, with one rule below."""
    angles = np.arange(-math.pi, math.pi + STEP / 2, STEP)
    direct = situations(model.robot, angles, hold=hold)
    prediction = model.predict(direct)
    assert prediction.duration is not None
    assert prediction.spread is not None
    tree = model.trees["duration"]
    features = [model.features[name] for name in tree.names]
    leaves = tree.apply(feature_table(direct, model.robot, features, model.driving))
    changes = np.flatnonzero(np.diff(leaves)) + 1
    figure = new_figure(8.0, 4.6)
    upper, lower = figure.subfigures(2, 1, height_ratios=(5.0, 1.6))
    _cartesian(upper.add_subplot(1, 2, 1), angles, prediction.duration, prediction.spread, changes)
    _polar(upper.add_subplot(1, 2, 2, projection="polar"), angles, prediction.duration, changes)
    rule = model.explain(situations(model.robot, np.array([EXAMPLE]), hold=hold)).splitlines()[0]
    lower.text(0.02, 0.9, f"rule at {math.degrees(EXAMPLE):.0f}°:", fontsize=7, va="top", color=GREY)
    lower.text(0.02, 0.72, textwrap.fill(rule, 118), fontsize=6.5, va="top", family="DejaVu Sans Mono")
    kind = "the ball" if hold else "a pose"
    figure.suptitle(f"{model.action} to {kind}: dist = {DISTANCE:g} m, angle_to_dest = 0°", fontsize=10)
    return figure


def _cartesian(axes: Any, angles: FloatArray, times: FloatArray, spread: FloatArray, changes: Any) -> None:
    degrees = np.degrees(angles)
    axes.fill_between(degrees, times - spread, times + spread, color=BLUE, alpha=0.15, lw=0)
    for begin, end in zip([0, *changes], [*changes, len(angles)], strict=True):
        axes.plot(degrees[begin:end], times[begin:end], color=BLUE, lw=1.5)
    for change in changes:
        axes.axvline((degrees[change - 1] + degrees[change]) / 2, color=ORANGE, lw=0.6, ls=":")
    axes.axvline(math.degrees(EXAMPLE), color=GREY, lw=0.8)
    axes.set(xlabel="angle_at_dest (degree)", ylabel="predicted execution time (s)", xlim=(-180, 180))
    axes.set_xticks(range(-180, 181, 60))
    axes.set_ylim(bottom=0.0)


def _polar(axes: Any, angles: FloatArray, times: FloatArray, changes: Any) -> None:
    axes.plot(angles, times, color=BLUE, lw=1.5)
    for change in changes:
        axes.plot([angles[change]] * 2, [0.0, float(times.max())], color=ORANGE, lw=0.6, ls=":")
    axes.set_theta_zero_location("E")
    axes.set_rlim(0.0, float(times.max()) * 1.08)
    axes.tick_params(labelsize=7)


def main(argv: Sequence[str] | None = None) -> int:
    """Draw the figure to a file and print the rule; return the exit code."""
    parser = argparse.ArgumentParser(prog="figure4", description=__doc__)
    parser.add_argument("--model", type=Path, help="default: the shipped goToPose")
    parser.add_argument("--pose", action="store_true", help="without a ball at the destination")
    parser.add_argument("--out", type=Path, default=Path("docs/figure4.svg"))
    options = parser.parse_args(argv)
    try:
        robot = SOCCER.robot()
        path = options.model or resource_path("models") / model_path("goToPose")
        model = load_model(path, robot, SOCCER.known_features)
    except (ConfigError, ModelFileError) as error:
        print(f"figure4: {error}", file=sys.stderr)
        return 1
    save_svg(figure4(model, hold=not options.pose), options.out)
    print(model.explain(situations(robot, np.array([EXAMPLE]), hold=not options.pose)))
    print(f"wrote {options.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
