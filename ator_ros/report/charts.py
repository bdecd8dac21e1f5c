"""The charts of the report."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ator_ros.actions.base import Goal
from ator_ros.drawing import BLUE, GREEN, GREY, ORANGE, RED, bars, binned, draw_robot, marked, new_figure
from ator_ros.geometry import FloatArray, Pose, wrap_angles
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import TopChain
from ator_ros.world.state import World

Record = Mapping[str, Any]
_STREAM_COLOURS = {"shipped": BLUE, "learning": ORANGE, "offline": GREEN, "oracle": RED}
_CURVE_COLOURS = {"heading": BLUE, "heading and speed": ORANGE}


def gain_bars(summary: Mapping[str, Any]) -> Any:
    """Draw each policy's improvement over naive."""
    names = [name for name, row in summary.items() if isinstance(row, Mapping) and name != "naive"]
    values = [summary[name]["improvement_percent"] for name in names]
    intervals = [summary[name]["improvement_ci95"] for name in names]
    return bars(names, values, intervals, "time saved against naive, %")


def gain_against_situation(records: Sequence[Record], policies: Sequence[str], place: str) -> Any:
    """Draw the gain over naive against the bend at the first subgoal, and the distances to it and onward.

    Parameters
    ----------
    records : sequence of dict
        Of chains of two steps or more.
    policies : sequence of str
        The first is drawn as points, too.
    place : str
        What the first subgoal is, in a word.
    """
    start = np.array([record["start"] for record in records], dtype=float)
    to_first = start[:, 3:5] - start[:, 0:2]
    onward = start[:, 5:7] - start[:, 3:5]
    turn = np.arctan2(onward[:, 1], onward[:, 0]) - np.arctan2(to_first[:, 1], to_first[:, 0])
    bend = np.degrees(np.abs(wrap_angles(turn)))
    figure = new_figure(10.0, 3.4)
    panels = (
        (f"bend at the {place}, degrees", bend),
        (f"robot to {place}, m", np.hypot(*to_first.T)),
        (f"{place} to goal, m", np.hypot(*onward.T)),
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


def oracle_curve(records: Sequence[Record], place: str) -> Any:
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
    axes.set_xlabel(f"heading at the {place} against the naive one, degrees")
    axes.set_ylabel("executed time against naive, s")
    axes.legend(frameon=False, fontsize=8, title="quantile of situations", title_fontsize=8)
    return figure


def paths(
    robot: Robot,
    chain: TopChain,
    world: World,
    runs: Mapping[str, Mapping[str, Any]],
    draw: Callable[[Any, Robot], None],
) -> Any:
    """Draw the paths of the robot in one situation, its poses at the first two goals, and the objects.

    Parameters
    ----------
    robot : Robot
        Its shape.
    chain : TopChain
        The plan.
    world : World
        The start.
    runs : mapping
        By policy "path" (rows that begin with x, y in m), "heading" (rad) at the first goal, and "duration"
        (s).
    draw : callable
        Draws the surroundings.
    """
    figure = new_figure(4.4, 2.9)
    axes = figure.add_subplot()
    draw(axes, robot)
    first, *later = [_rounded(call.goal) for call in chain.calls[:2]]
    for (name, run), colour in zip(runs.items(), (ORANGE, BLUE), strict=False):
        path: FloatArray = np.array(run["path"], dtype=float)
        axes.plot(path[:, 0], path[:, 1], color=colour, lw=1.4, label=f"{name}, {run['duration']:.1f} s")
        reached = dataclasses.replace(first, pose=first.pose._replace(yaw=run["heading"]))
        draw_robot(axes, robot, reached.robot_pose(robot), colour)
    draw_robot(axes, robot, _rounded(Goal(world.robot.pose)).pose, "#333333")
    for goal in later:
        draw_robot(axes, robot, goal.robot_pose(robot), GREEN)
    for there in world.objects.values():
        axes.plot(round(there.x, 4), round(there.y, 4), "o", color="black", ms=4)
    axes.set_aspect("equal")
    axes.axis("off")
    axes.legend(frameon=False, fontsize=7.5, loc="upper center", bbox_to_anchor=(0.5, -0.01), ncols=2)
    return figure


def stream_gains(streams: Mapping[str, Sequence[Record]]) -> Any:
    """Draw the mean gain over naive so far against the chains played, one panel for each robot."""
    figure = new_figure(3.2 * len(streams), 3.0)
    for number, (change, results) in enumerate(streams.items(), start=1):
        axes = figure.add_subplot(1, len(streams), number)
        for name, colour in _STREAM_COLOURS.items():
            if name in results[0]["durations"]:
                gains = [r["durations"]["naive"] - r["durations"][name] for r in results]
                means = np.cumsum(gains) / np.arange(1, len(results) + 1)
                axes.plot(means, color=colour, lw=1.4, label=name)
        switches = [i for i in range(1, len(results)) if results[i]["set"] != results[i - 1]["set"]]
        for index in switches:
            axes.axvline(index, color=GREY, lw=0.6, ls=":")
        axes.set_title(change)
        axes.set_xlabel("chains played")
        axes.set_ylabel("mean gain over naive, s")
        axes.legend(frameon=False)
    return figure


def learning_curve(points: Mapping[str, Mapping[str, Record]]) -> Any:
    """Draw the shares of the oracle's gain, with intervals, against the episodes; dashed: described models.

    Parameters
    ----------
    points : mapping
        By what is open, and by number of episodes or "described": see `evaluation.learning_curve.points`.
    """
    figure = new_figure(4.5, 3.2)
    axes = figure.add_subplot()
    for kind, colour in _CURVE_COLOURS.items():
        sizes = [size for size in points[kind] if size != "described"]
        rows = [points[kind][size] for size in sizes]
        x, y = [int(size) for size in sizes], [row["percent"] for row in rows]
        below, above = ([abs(row["ci95"][end] - row["percent"]) for row in rows] for end in (0, 1))
        marked(axes, x, y, errors=[below, above], colour=colour, label=kind)
        axes.axhline(points[kind]["described"]["percent"], color=colour, lw=0.8, ls="--")
    axes.set_xscale("log")
    axes.set_xlabel("episodes per action")
    axes.set_ylabel("share of the oracle's gain, %")
    axes.legend(frameon=False)
    return figure


def _rounded(goal: Goal) -> Goal:
    """Return a goal with its pose as exact as the records are."""
    return dataclasses.replace(goal, pose=Pose(*(round(value, 4) for value in goal.pose)))


def _durations(records: Sequence[Record], policy: str) -> FloatArray:
    return np.array([record["policies"][policy]["duration"] for record in records], dtype=float)


def _best(records: Sequence[Record]) -> FloatArray:
    return np.array([record["oracle"]["best"] for record in records], dtype=float)
