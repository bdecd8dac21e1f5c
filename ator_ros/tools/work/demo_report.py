"""The demo's results as a table and as a picture (without ROS)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ator_ros.drawing import BLUE, GREEN, GREY, ORANGE, draw_robot, new_figure
from ator_ros.files import replaced
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import TopChain
from ator_ros.world.state import World

PICTURE = (
    "the robot's path in each situation, naive (orange) and refined (blue); "
    "dots are objects, crosses the goals of the steps, green where nothing is open"
)
"""What `save_picture` draws."""
_COLUMNS = 3


@dataclass(frozen=True)
class DemoRun:
    """One execution of a chain.

    Attributes
    ----------
    success : bool
        Whether the chain reached its end.
    reason : str
        How it ended, in words.
    refinement : str
        Why it was refined or left alone.
    refined : bool
        Whether a subgoal was changed.
    predicted, actual : tuple of float
        Times of its actions in s, NaN where not known; `actual` as far as it came.
    total : tuple of float
        Predicted and actual time of the chain in s.
    path : list of (x, y)
        Where the robot was, in m.
    """

    success: bool
    reason: str
    refinement: str
    refined: bool
    predicted: tuple[float, ...]
    actual: tuple[float, ...]
    total: tuple[float, float]
    path: list[tuple[float, float]] = field(default_factory=list)


@dataclass(frozen=True)
class DemoSituation:
    """One situation: how it starts, the chain, and how it went naive and refined."""

    start: World
    chain: TopChain
    naive: DemoRun
    refined: DemoRun

    @property
    def gain(self) -> float:
        """Time saved in s; NaN when one of the two failed."""
        both = self.naive.success and self.refined.success
        return self.naive.total[1] - self.refined.total[1] if both else math.nan


def explanation(name: str, chain: TopChain, known: Mapping[str, str]) -> str:
    """Return what a chain is, what it leaves open, and what naive and refined mean, one line each.

    Parameters
    ----------
    name : str
        Name of the chain.
    chain : TopChain
        An example of it.
    known : mapping of str to str
        Descriptions of chains by name.
    """
    steps = [
        (f"step {number} ({call.top.name})", sorted(call.open)) for number, call in enumerate(chain.calls, 1)
    ]
    opened = [f"{' and '.join(names)} at the end of {step}" for step, names in steps if names]
    tops = ", ".join(call.top.name for call in chain.calls)
    return "\n".join(
        [
            f"chain {name}: {known.get(name, f'{len(steps)} steps')} ({tops})",
            f"open, for refinement to choose: {'; '.join(opened) or 'nothing'}",
            "naive: each step alone is fastest, and the robot stops; refined: the whole chain is fastest",
        ]
    )


def table(situations: Sequence[DemoSituation]) -> str:
    """Return predicted / actual times in s of each action and chain, a line for each run."""
    if not situations:
        return "no situation was finished"
    longest = max((situation.chain for situation in situations), key=len)
    tops = [call.top.name for call in longest.calls]
    head = ["", "", *tops, "chain", "gain"]
    rows = [head]
    for number, situation in enumerate(situations, start=1):
        rows.append([str(number), "naive", *_cells(situation.naive, len(tops)), ""])
        gain = situation.gain
        percent = 100.0 * gain / (situation.naive.total[1] or math.inf)  # a run may end before it began
        gain, percent = round(gain, 2) + 0.0, round(percent) + 0.0 if math.isfinite(percent) else percent
        saved = "-" if math.isnan(gain) else f"{gain:+.2f} s ({percent:+.0f} %)"
        kind = "refined" if situation.refined.refined else "left alone"
        rows.append(["", kind, *_cells(situation.refined, len(tops)), saved])
    widths = [max(len(row[column]) for row in rows) for column in range(len(head))]
    lines = ["  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows]
    lines.insert(1, "-" * len(lines[0]))
    return "\n".join(["predicted / actual time in s", *lines, "", summary(situations)])


def _cells(run: DemoRun, steps: int) -> list[str]:
    actual = [*run.actual, *[math.nan] * (len(run.predicted) - len(run.actual))]
    cells = [_pair(p, a) for p, a in zip(run.predicted, actual, strict=True)]
    return [*cells, *[""] * (steps - len(cells)), _pair(*run.total) if run.success else "failed"]


def _pair(predicted: float, actual: float) -> str:
    return " / ".join("-" if math.isnan(value) else f"{value:.2f}" for value in (predicted, actual))


def summary(situations: Sequence[DemoSituation]) -> str:
    """Return a summary in one sentence, with the reasons of failures."""
    counted = [situation for situation in situations if not math.isnan(situation.gain)]
    naive = math.fsum(situation.naive.total[1] for situation in counted)
    gain = math.fsum(situation.gain for situation in counted)
    percent = 100.0 * abs(gain) / naive if naive else 0.0
    verb = "saved" if gain >= 0.0 else "cost"
    lines = [
        f"{len(counted)} of {len(situations)} situations succeeded both ways; "
        f"refinement {verb} {abs(gain):.2f} s of {naive:.2f} s ({percent:.1f} %)"
    ]
    for number, situation in enumerate(situations, start=1):
        for name, run in (("naive", situation.naive), ("refined", situation.refined)):
            if not run.success:
                lines.append(f"situation {number}, {name}: {run.reason}")
    alone = {s.refined.refinement for s in situations if not s.refined.refined}
    return "\n".join(lines + [f"left alone: {reason}" for reason in sorted(alone)])


def save_picture(file: Path, robot: Robot, situations: Sequence[DemoSituation]) -> None:
    """Write the paths in the scene, a panel for each situation, as a PNG file."""
    rows = math.ceil(len(situations) / _COLUMNS)
    figure = new_figure(4.6 * _COLUMNS, 3.4 * rows)
    for number, situation in enumerate(situations, start=1):
        axes = figure.add_subplot(rows, _COLUMNS, number)
        _panel(axes, robot, situation)
        axes.set_title(f"{number}", fontsize=9, loc="left")
    with replaced(file) as temporary:
        figure.savefig(temporary, format="png", dpi=130)


def _panel(axes: Any, robot: Robot, situation: DemoSituation) -> None:
    x_min, y_min, x_max, y_max = robot.scene.area.lines
    axes.plot([x_min, x_max, x_max, x_min, x_min], [y_min, y_min, y_max, y_max, y_min], color=GREY, lw=0.8)
    for bay in robot.scene.bays:
        across = np.array([-math.sin(bay.yaw), math.cos(bay.yaw)]) * bay.width / 2.0
        middle = np.array([bay.x, bay.y])
        ends = np.stack([middle + across, middle - across])
        axes.plot(*ends.T, color="black", lw=3.0)
    draw_robot(axes, robot, situation.start.robot.pose, "#333333")
    for there in situation.start.objects.values():
        axes.plot(there.x, there.y, "o", color="black", ms=4)
    for call in situation.chain.calls:
        colour = "#333333" if call.open else GREEN
        axes.plot(call.goal.pose.x, call.goal.pose.y, "+", color=colour, ms=7)
    second = "refined" if situation.refined.refined else "left alone"
    for name, run, colour in (("naive", situation.naive, ORANGE), (second, situation.refined, BLUE)):
        time = f"{run.total[1]:.2f} s" if run.success else "failed"
        path = np.array(run.path).reshape(-1, 2)
        axes.plot(path[:, 0], path[:, 1], color=colour, lw=1.5, label=f"{name}, {time}")
    axes.set_aspect("equal")
    axes.axis("off")
    axes.legend(frameon=False, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, 0.02), ncols=2)
