"""The charts of the report; matplotlib without a window."""

from __future__ import annotations

import io
import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from ator_ros.files import write_text
from ator_ros.geometry import FloatArray, Pose, wrap_angles
from ator_ros.robot.description import Robot

Record = Mapping[str, Any]
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


def gain_bars(summary: Mapping[str, Any]) -> Any:
    """Draw each policy's improvement over naive."""
    names = [name for name, row in summary.items() if isinstance(row, Mapping) and name != "naive"]
    values = [summary[name]["improvement_percent"] for name in names]
    intervals = [summary[name]["improvement_ci95"] for name in names]
    return bars(names, values, intervals, "time saved against naive, %")


def gain_against_situation(records: Sequence[Record], policies: Sequence[str]) -> Any:
    """Draw the gain over naive against the bend at the first subgoal, and the distances to it and onward.

    Parameters
    ----------
    records : sequence of dict
        Of chains of two steps or more.
    policies : sequence of str
        The first is drawn as points, too.
    """
    start = np.array([record["start"] for record in records], dtype=float)
    to_first = start[:, 3:5] - start[:, 0:2]
    onward = start[:, 5:7] - start[:, 3:5]
    turn = np.arctan2(onward[:, 1], onward[:, 0]) - np.arctan2(to_first[:, 1], to_first[:, 0])
    bend = np.degrees(np.abs(wrap_angles(turn)))
    figure = new_figure(10.0, 3.4)
    panels = (
        ("bend at the first subgoal, degrees", bend),
        ("robot to first subgoal, m", np.hypot(*to_first.T)),
        ("first subgoal to next, m", np.hypot(*onward.T)),
    )
    naive = _durations(records, "naive")
    for number, (title, values) in enumerate(panels, start=1):
        axes = figure.add_subplot(1, 3, number)
        for policy, colour in zip(policies, (BLUE, ORANGE, GREEN), strict=False):
            gain = naive - _best(records) if policy == "oracle" else naive - _durations(records, policy)
            if policy == policies[0]:
                axes.plot(values, gain, ".", color=GREY, ms=2.0, alpha=0.5, rasterized=True)
            binned(axes, values, gain, bins=8, colour=colour, label=policy)
        axes.axhline(0.0, color="#333", lw=0.8)
        axes.set_xlabel(title)
        if number == 1:
            axes.set_ylabel("time saved against naive, s")
            axes.legend(frameon=False, fontsize=8)
    return figure


def predicted_against_actual(records: Sequence[Record], policy: str, key: str) -> Any:
    """Draw the gain that was predicted against the gain that came, with the runs made worse in red."""
    rows = [record for record in records if record.get(key)]
    predicted = np.array([record[key]["gain"] for record in rows])
    naive, taken = _durations(rows, "naive"), _durations(rows, policy)
    gain = naive - taken
    worse = gain < -0.02 * naive
    figure = new_figure(5.2, 4.2)
    axes = figure.add_subplot()
    limit = float(np.quantile(predicted, 0.995)) * 1.15 + 0.2
    axes.plot([0.0, limit], [0.0, limit], color="#333", lw=0.8)
    axes.axhline(0.0, color="#333", lw=0.8)
    axes.plot(predicted[~worse], gain[~worse], ".", color=BLUE, ms=3.0, alpha=0.6, rasterized=True)
    axes.plot(predicted[worse], gain[worse], ".", color=RED, ms=5.0, rasterized=True, label="worse")
    axes.set_xlim(-0.1, limit)
    axes.set_ylim(max(-3.0, float(gain.min()) - 0.2), limit)
    axes.set_xlabel("predicted gain, s")
    axes.set_ylabel("actual gain, s")
    if worse.any():
        axes.legend(frameon=False, fontsize=8)
    return figure


def oracle_curve(records: Sequence[Record]) -> Any:
    """Draw the mean executed duration against the heading's distance from the naive one."""
    curves = np.array([record["oracle"]["durations"] for record in records], dtype=float)
    count = len(records[0]["oracle"]["headings"])
    naive = _durations(records, "naive")[:, None]
    change = curves[:, :count] - naive
    degrees = np.degrees(wrap_angles(2.0 * math.pi * np.arange(count) / count))
    order = np.argsort(degrees)
    figure = new_figure(5.2, 3.2)
    axes = figure.add_subplot()
    for quantile, colour in ((0.1, GREEN), (0.5, BLUE), (0.9, ORANGE)):
        axes.plot(
            degrees[order],
            np.quantile(change, quantile, axis=0)[order],
            color=colour,
            label=f"{quantile:.0%}",
        )
    axes.axhline(0.0, color="#333", lw=0.8)
    axes.set_xlabel("heading at the first subgoal against the naive one, degrees")
    axes.set_ylabel("executed time against naive, s")
    axes.legend(frameon=False, fontsize=8, title="quantile of situations", title_fontsize=8)
    return figure


def _durations(records: Sequence[Record], policy: str) -> FloatArray:
    return np.array([record["policies"][policy]["duration"] for record in records], dtype=float)


def _best(records: Sequence[Record]) -> FloatArray:
    return np.array([record["oracle"]["best"] for record in records], dtype=float)
