"""What a view writes: clock, times step by step, the gate's reason, the rules that decided."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from ator_ros.performance.model import PerformanceModel
from ator_ros.refinement.chain_prediction import chain_situations
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import TopChain
from ator_ros.viewing.advice import Advice
from ator_ros.viewing.markdown import plain, seconds
from ator_ros.viewing.runs import Run
from ator_ros.world.state import World

_SILENCE = 2.0


def clock(world: World | None, *, paused: bool, status: str, silence: float = 0.0, refused: str = "") -> str:
    """Return the simulated time, and what is going on.

    Parameters
    ----------
    world : World or None
        The newest state.
    paused : bool
        Whether time stands still.
    status : str
        What is going on.
    silence : float
        Real s since the robot was last heard of.
    refused : str
        Why something was not put where it was dragged to; empty where it was.
    """
    if world is None:
        return "waits for word of the robot, from odom or tf"
    if silence > _SILENCE and not paused:
        status = f"no word of the robot for {silence:.0f} s"
    told = f"**{world.time:.2f} s**{' (paused)' if paused else ''} · {plain(status)}"
    return f"{told}\n\n**not moved:** {plain(refused)}" if refused else told


def times(advice: Advice | None, runs: Sequence[Run]) -> str:
    """Return a Markdown table: predictions for both chains, and each run's actual times, step by step."""
    if advice is None:
        return ""
    tops = [plain(call.top.name) for call in advice.chain.calls]
    rows = [
        ("naive, predicted", advice.before, sum(advice.before)),
        ("best, predicted", advice.after, sum(advice.after)),
        *((f"{run.label}, driven", tuple(run.actual), run.elapsed) for run in runs),
    ]
    table = [f"| s | {' | '.join(tops)} | chain |", f"|---|{'---|' * (len(tops) + 1)}"]
    for label, values, whole in rows:
        cells = [seconds(value) for value in (*values, *[math.nan] * (len(tops) - len(values)))]
        table.append(f"| {label} | {' | '.join(cells)} | {seconds(whole)} |")
    return "\n".join(table)


def gate(advice: Advice | None, problem: str) -> str:
    """Return why the chain was refined or left alone, or why that is not known."""
    if problem:
        return f"**not refined:** {plain(problem)}"
    if advice is None:
        return "no chain"
    told = f"**{'refined' if advice.refined else 'left alone'}:** {plain(advice.reason)}"
    rows = [
        f"- {'**chosen:** ' if number == advice.chosen else ''}{_candidate(number)} "
        f"{seconds(each.duration)} s, cost {seconds(each.cost)} s ({plain(each.reason)})"
        for number, each in enumerate(advice.candidates)
    ]
    return "\n".join([told, "", *rows]) if rows else told


def _candidate(number: int) -> str:
    return "the chain" if number == 0 else f"alternative {number}"


def rules(world: World, chain: TopChain, robot: Robot, models: Mapping[str, PerformanceModel]) -> str:
    """Return, step by step, the rule that predicts the duration and what its terms add in this situation."""
    parts = []
    for call, situation in zip(chain.calls, chain_situations(world, chain, robot), strict=True):
        model = models.get(call.top.action)
        told = "no model" if model is None else model.explain(situation)
        parts.append(f"**{plain(call.top.name)}**\n```\n{told}\n```")
    return "\n\n".join(parts)
