"""Execute random chains of a domain naive and refined, over ROS (paper, Figure 1)."""

from __future__ import annotations

import argparse
import dataclasses
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon
from PIL import Image

from ator_ros.bases.description import Robot
from ator_ros.domains.domain import Domain
from ator_ros.domains.trials import Trial, open_speeds, random_trial
from ator_ros.files import atomic_write
from ator_ros.geometry import Pose
from ator_ros.refinement.refiner import ITS_DEADLINE
from ator_ros.tools.command_line import (
    add_factor,
    add_models,
    add_setting,
    destination,
    run_tool,
    source_of,
    whole,
)
from ator_ros.tools.floor_plan import BLUE, draw_floor, draw_stations
from ator_ros.tools.own_nodes import all_nodes, connected
from ator_ros.tops.chain import TopChain
from ator_ros.view.backend import Backend
from ator_ros.view.draft import Draft
from ator_ros.view.runs import Answer, Run, seconds
from ator_ros.world.state import World

_LEGEND = (
    "the robot's path in each situation, naive (orange) and refined (blue); "
    "arrows show the start, dots objects, and crosses the goals of steps (green: nothing is open), "
    "numbers the stations of a round, in brackets their places in the refined order, and those "
    "that are passed"
)
_COLUMNS = 3  # most panels side by side
_MOST_SITUATIONS = 200  # that fit into one picture
ORANGE, GREEN, DARK = "#d9791a", "#2e7d4f", "#333333"
_MOVED = 0.005  # m; beyond the noise of odometry of a robot that stands
_FRAME = 0.1  # s; a GIF of a race of 15 s with the colors below has less than 2 MB
_FRAME_COLORS = 48
_PAUSE = 2.5  # s at the end of an animation, to read the times


@dataclass(frozen=True)
class DemoSituation:
    """A start with a chain, refinement's answer for it, and both executions."""

    start: World
    chain: TopChain
    answer: Answer
    naive: Run
    refined: Run

    @property
    def runs(self) -> dict[str, Run]:
        """Both executions by name."""
        return {
            "naive": self.naive,
            "refined" if self.refined.record.refined else "unchanged": self.refined,
        }

    @property
    def gain(self) -> float:
        """Time saved in s; 0 if refinement changed nothing, NaN if one of the two failed."""
        gain = self.naive.duration - self.refined.duration
        # two executions of the same chain differ by noise
        return gain if math.isnan(gain) or self.refined.record.refined else 0.0

    @property
    def cut_short(self) -> bool:
        """Whether a deadline ended a search for this situation."""
        return self.answer.cut_short or ITS_DEADLINE in self.refined.record.refinement


def explanation(name: str, chain: TopChain) -> str:
    """Return lines on the steps of a chain, its open variables, and what is compared."""
    variables = [
        f"{' and '.join(sorted(call.open))} at the end of step {number} ({call.top.name})"
        for number, call in enumerate(chain.calls, 1)
        if call.open
    ]
    return (
        f"chain {name}: {', '.join(call.top.name for call in chain.calls)}\n"
        f"open, for refinement to choose: {'; '.join(variables) or 'nothing'}\n"
        "naive: each step alone is fastest, and the robot stops; "
        "refined: the whole chain is fastest"
    )


def table(situations: Sequence[DemoSituation]) -> str:
    """Return predicted / actual times in s of each action and chain, by run, and a summary."""
    rows = []
    for number, situation in enumerate(situations, start=1):
        gain = situation.gain
        # a chain may end immediately
        percent = 100.0 * gain / (situation.naive.duration or math.inf)
        change = "-" if math.isnan(gain) else f"{gain:+.2f} s ({percent:+.0f} %)"
        mark = "*" if situation.cut_short else ""
        for name, run in situation.runs.items():
            is_naive = run is situation.naive
            row = {"": f"{number} {name}{'' if is_naive else mark}"}
            rows.append({**row, **_times(situation, run), "gain": "" if is_naive else change})
    frame = pd.DataFrame(rows).fillna("")  # chains may have different numbers of steps
    last = ["chain", "gain"]
    text = frame[[*frame.columns.difference(last, sort=False), *last]].to_string(index=False)
    return f"predicted / actual time in s\n{text}\n\n{_summary(situations)}"


def _times(situation: DemoSituation, run: Run) -> dict[str, str]:
    """Return predicted and actual time of each step and of the chain."""
    answer = situation.answer
    predicted = answer.after if run.record.refined else answer.before
    cells = {}
    for index, call in enumerate(situation.chain.calls):
        if index in run.actual:  # not all if it failed
            name = f"{index + 1} {call.top.name}"
            cells[name] = f"{seconds(predicted[index])} / {seconds(run.actual[index])}"
    of_chain = f"{seconds(sum(predicted))} / {seconds(run.duration)}"
    return {**cells, "chain": "failed" if math.isnan(run.duration) else of_chain}


def _summary(situations: Sequence[DemoSituation]) -> str:
    """Return the total gain, the reasons of failures, and why chains were not refined."""
    succeeded = [situation for situation in situations if not math.isnan(situation.gain)]
    naive = math.fsum(situation.naive.duration for situation in succeeded)
    gain = math.fsum(situation.gain for situation in succeeded)
    percent = 100.0 * abs(gain) / naive if naive else 0.0
    verb = "saved" if gain >= 0.0 else "cost"
    lines = [
        f"{len(succeeded)} of {len(situations)} situations succeeded with both chains; "
        f"refinement {verb} {abs(gain):.2f} s of {naive:.2f} s ({percent:.1f} %)"
    ]
    for number, situation in enumerate(situations, start=1):
        for name, run in (("naive", situation.naive), ("refined", situation.refined)):
            if math.isnan(run.duration):
                lines.append(f"situation {number}, {name}: {run.record.outcome.reason}")
    if any(each.cut_short for each in situations):
        lines.append("* the deadline cut the search short: a longer one may save more")
    reasons = {
        each.refined.record.refinement for each in situations if not each.refined.record.refined
    }
    return "\n".join(lines + [f"unchanged: {reason}" for reason in sorted(reasons)])


def save_picture(
    file: Path, domain: Domain, robot: Robot, situations: Sequence[DemoSituation]
) -> None:
    """Draw the paths of each situation in a panel, and write a PNG file."""
    columns = min(len(situations), _COLUMNS)
    rows = math.ceil(len(situations) / columns)
    figure = Figure(figsize=(4.6 * columns, 3.4 * rows), layout="constrained")
    for number, situation in enumerate(situations, start=1):
        axes = figure.add_subplot(rows, columns, number)
        _draw_floor(axes, domain, robot, situation)
        pose = situation.start.robot.pose
        axes.quiver(pose.x, pose.y, math.cos(pose.yaw), math.sin(pose.yaw), color=DARK, scale=18.0)
        for state in situation.start.objects.values():
            axes.plot(state.x, state.y, "o", color="black", ms=4)
        for (name, run), color in zip(situation.runs.items(), (ORANGE, BLUE), strict=True):
            time = "failed" if math.isnan(run.duration) else f"{run.duration:.2f} s"
            axes.plot(*_columns(run.path), color=color, lw=1.5, label=f"{name}, {time}")
        axes.legend(
            frameon=False, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, 0.02), ncols=2
        )
        axes.set_title(f"{number}", fontsize=9, loc="left")
    with atomic_write(file) as temporary:
        figure.savefig(temporary, format="png", dpi=130)


def _draw_floor(axes: Axes, domain: Domain, robot: Robot, situation: DemoSituation) -> None:
    """Draw the surroundings and the goals of the steps, with numbers if their order is open."""
    draw_floor(axes, domain, robot)
    for call in situation.chain.calls:
        axes.plot(*call.goal.pose[:2], "+", color=DARK if call.open else GREEN, ms=7)
    draw_stations(axes, situation.answer.chain)
    axes.axis("off")


def _columns(points: Sequence[tuple[float, float]]) -> np.ndarray:
    """Return the x and the y of points, shape (2, n)."""
    return np.array(points).reshape(-1, 2).T


def save_animation(file: Path, domain: Domain, robot: Robot, situation: DemoSituation) -> None:
    """Draw both executions of a situation as a race in real time, and write a GIF file."""
    area = robot.scene.area
    figure = Figure(figsize=(7.0, 7.0 * area.width / area.length + 0.5), layout="constrained")
    axes = figure.add_subplot()
    _draw_floor(axes, domain, robot, situation)
    naive, refined = situation.runs.items()
    racers = [
        _Racer(axes, robot, *naive, color=ORANGE, loc="left"),
        _Racer(axes, robot, *refined, color=BLUE, loc="right"),
    ]
    end = max(situation.naive.duration, situation.refined.duration) + _PAUSE
    frames: list[Image.Image] = []
    for now in np.arange(0.0, end, _FRAME):
        for racer in racers:
            racer.show(float(now))
        picture = io.BytesIO()
        figure.savefig(picture, format="png", dpi=100)
        image = Image.open(picture).convert("RGB")
        # one palette for all frames: then a GIF stores only what changes between two of them
        palette = frames[0] if frames else image.quantize(_FRAME_COLORS)
        frames.append(image.quantize(palette=palette, dither=Image.Dither.NONE))
    with atomic_write(file) as temporary:
        frames[0].save(
            temporary,
            format="GIF",
            save_all=True,
            append_images=frames[1:],
            duration=1000.0 * _FRAME,
            loop=0,
        )


class _Racer:
    """One execution in an animation: the robot, the objects, its path so far, and a clock."""

    def __init__(
        self,
        axes: Axes,
        robot: Robot,
        name: str,
        run: Run,
        *,
        color: str,
        loc: Literal["left", "right"],
    ) -> None:
        self._axes, self._robot, self._run = axes, robot, run
        self._name, self._color, self._loc = name, color, loc
        start = run.worlds[0].robot.pose
        moved = (world for world in run.worlds if world.robot.pose.distance(start) > _MOVED)
        began = next(moved, run.worlds[0]).time
        self._times = np.array([world.time for world in run.worlds]) - began
        (self._trail,) = axes.plot([], [], color=color, lw=1.5)
        self._body = Polygon([(0.0, 0.0)], color=color, alpha=0.7)
        self._objects = {
            name: Circle((0.0, 0.0), item.radius, color=color, ec=DARK)
            for name, item in robot.scene.objects.items()
        }
        for patch in (self._body, *self._objects.values()):
            axes.add_patch(patch)

    def show(self, now: float) -> None:
        """Show the state `now` s after the start."""
        duration = self._run.duration
        last = int(np.searchsorted(self._times, min(now, duration), side="right"))
        world = self._run.worlds[max(last - 1, 0)]
        robot = self._robot
        pose = world.robot.pose
        corners = (
            (robot.front, robot.half_width),
            (robot.front + 0.5 * robot.half_width, 0.0),  # shows the heading
            (robot.front, -robot.half_width),
            (-robot.rear, -robot.half_width),
            (-robot.rear, robot.half_width),
        )
        self._body.set_xy([pose.compose(Pose(x, y, 0.0))[:2] for x, y in corners])
        self._trail.set_data(*_columns(self._run.path[:last]))
        for name, state in world.objects.items():
            if name in self._objects:
                self._objects[name].center = (state.x, state.y)
        clock = f"{self._name} {min(now, duration):.1f} s"
        self._axes.set_title(clock, color=self._color, loc=self._loc, fontsize=15, weight="bold")


def _demo(options: argparse.Namespace, domain: Domain, _: str) -> None:
    """Execute the situations; print a table and write pictures, also after an interruption."""
    if options.team:
        from ator_ros.tools import team_demo  # few need it

        scenes = [team_demo.play_soccer()]
        scenes.append(team_demo.play_round(options.seed, options.real_time_factor))
        team_demo.save_scenes(options.out, scenes)
        print(f"\n{options.out.resolve()}: where the robots drove; dots show the starts")
        return
    source = source_of(options)
    robot = source.described()
    library = domain.library(robot)
    finished: list[DemoSituation] = []
    try:
        with all_nodes(options.real_time_factor, source) as nodes:
            names = " and ".join(("three nodes", *(server.name for server in domain.servers)))
            print(f"{names} start on ROS domain {nodes.domain} …", flush=True)
            with connected(nodes, domain, robot, domain.remote_servers()) as backend:
                for index in range(options.situations):
                    trial = random_trial(
                        domain, options.chain, library, seed=options.seed, index=index
                    )
                    if "speed" in domain.variables:
                        trial = dataclasses.replace(trial, chain=open_speeds(trial.chain))
                    if index == 0:
                        print(explanation(options.chain, trial.chain), flush=True)
                    print(f"situation {index + 1} of {options.situations}:", end="", flush=True)
                    finished.append(_execute(backend, trial, library.action_set))
    finally:
        if finished:
            print(f"\n{table(finished)}")
            save_picture(options.out, domain, robot, finished)
            print(f"\n{options.out.resolve()}: {_LEGEND}")
            races = [each for each in finished if not math.isnan(each.gain)]
            if options.animation and races:
                race = max(races, key=lambda each: each.gain)
                save_animation(options.animation, domain, robot, race)
                print(f"{options.animation.resolve()}: situation {finished.index(race) + 1}")
            print("make view shows chains live, in the browser")


def _execute(backend: Backend, trial: Trial, action_set: str) -> DemoSituation:
    draft = Draft(trial.world, trial.chain, action_set)
    try:
        answer, runs = backend.refine(draft), []
        for label, chain in (("naive", answer.naive), ("refined", trial.chain)):
            backend.place(trial.world)
            run_draft = dataclasses.replace(draft, chain=chain)
            runs.append(backend.drive(label, run_draft, refine=label == "refined"))
            print(f" {label} {runs[-1].duration:.2f} s", end="", flush=True)
    finally:
        print(flush=True)  # also before the message of an interruption
    return DemoSituation(trial.world, trial.chain, answer, *runs)


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `demo`."""
    parser = argparse.ArgumentParser(prog="demo", description=__doc__)
    parser.add_argument(
        "--situations", type=whole(1, _MOST_SITUATIONS), default=6, metavar="N",
        help="default: %(default)s",
    )  # fmt: skip
    parser.add_argument(
        "--seed", type=whole(), default=401, help="of the situations (default: %(default)s)"
    )
    parser.add_argument(
        "--team", action="store_true",
        help="instead play a scene of soccer and one of deliveries with a team of three; only "
        "--seed, --real-time-factor and --out count",
    )  # fmt: skip
    add_setting(parser, action_set=False)
    parser.add_argument("--chain", metavar="NAME", help="of the domain (default: its last)")
    add_factor(parser, 0.0)
    add_models(parser)
    parser.add_argument(
        "--out", type=destination, default=Path("build/demo.png"), metavar="FILE.png",
        help="default: %(default)s",
    )  # fmt: skip
    parser.add_argument(
        "--animation", type=destination, metavar="FILE.gif",
        help="also draw the race with the greatest gain",
    )  # fmt: skip
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    return run_tool(
        arguments(),
        _demo,
        argv,
        interrupted="the finished situations are shown",
        chain=lambda domain: reversed(list(domain.chains)),
    )
