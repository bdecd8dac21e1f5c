"""What figures share; matplotlib without a window."""

from __future__ import annotations

import io
import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from ator_ros.files import write_text
from ator_ros.geometry import Pose
from ator_ros.robot.description import Robot

BLUE, ORANGE, GREY, RED, GREEN = "#1f5fa8", "#d9791a", "#8a8f98", "#b3261e", "#2e7d4f"
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


def svg_text(figure: Any) -> str:
    """Return the figure as an SVG element to stand in a page; the same figure gives the same text."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def save_svg(figure: Any, path: Path) -> None:
    """Write the figure as an SVG file, atomically."""
    write_text(path, '<?xml version="1.0" encoding="utf-8"?>\n' + svg_text(figure))


def draw_robot(axes: Any, robot: Robot, pose: Pose, colour: str, *, alpha: float = 0.85) -> None:
    """Draw the robot's outline at `pose`, with a line that shows its front."""
    front, rear, half = robot.front, -robot.rear, robot.half_width
    corners = np.array([[front, half], [front, -half], [rear, -half], [rear, half]])
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    outline = corners @ np.array([[c, s], [-s, c]]) + [pose.x, pose.y]
    axes.fill(outline[:, 0], outline[:, 1], facecolor=colour, edgecolor="none", alpha=0.25 * alpha)
    axes.plot(*np.append(outline, outline[:1], axis=0).T, color=colour, lw=1.0, alpha=alpha)
    tip = pose.ahead(robot.front)
    axes.plot([pose.x, tip.x], [pose.y, tip.y], color=colour, lw=1.6, alpha=alpha)


def bars(
    names: Sequence[str], values: Sequence[float], intervals: Sequence[Sequence[float]], unit: str
) -> Any:
    """Draw horizontal bars with their 95 % intervals."""
    figure = new_figure(8.0, 0.32 * len(names) + 0.8)
    axes = figure.add_subplot()
    rows = np.arange(len(names))[::-1]
    errors = np.abs(np.array(intervals, dtype=float).T - np.array(values))
    colours = [BLUE if name.startswith(("gated", "refined")) else GREY for name in names]
    colours = [GREEN if name.startswith("oracle") else c for name, c in zip(names, colours, strict=True)]
    axes.barh(rows, values, xerr=errors, color=colours, height=0.62, error_kw={"lw": 1.0, "ecolor": "#333"})
    axes.set_yticks(rows, names)
    axes.axvline(0.0, color="#333", lw=0.8)
    axes.set_xlabel(unit)
    axes.grid(visible=False, axis="y")
    return figure


def binned(
    axes: Any, x: np.ndarray[Any, Any], y: np.ndarray[Any, Any], *, bins: int, colour: str, label: str
) -> None:
    """Draw the mean of y with its 95 % interval over bins of x that hold about as many points each."""
    edges = np.quantile(x, np.linspace(0.0, 1.0, bins + 1))
    centres, means, errors = [], [], []
    for low, high in itertools.pairwise(edges):
        inside = y[(x >= low) & (x <= high)]
        if len(inside) > 1:
            centres.append((low + high) / 2.0)
            means.append(inside.mean())
            errors.append(1.96 * inside.std(ddof=1) / math.sqrt(len(inside)))
    marked(axes, centres, means, errors=errors, colour=colour, label=label)


def marked(axes: Any, x: Any, y: Any, *, errors: Any, colour: str, label: str) -> None:
    """Draw y with its errors over x, as a line with a mark at each point."""
    axes.errorbar(x, y, yerr=errors, color=colour, marker="o", ms=3.5, lw=1.4, label=label)
