"""Streams of chains that are played in parts, and what they come to."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ator_ros.drawing import BLUE, GREEN, GREY, ORANGE, RED, new_figure
from ator_ros.evaluation.errors import EvaluationError
from ator_ros.evaluation.statistics import mean_interval
from ator_ros.files import read_text
from ator_ros.learning.stream import ORACLE, POLICIES, Stream, StreamSettings

_LARGEST = 100_000_000
_COLOURS = {"shipped": BLUE, "learning": ORANGE, "offline": GREEN, ORACLE: RED}


def play(settings: StreamSettings, chains: int, folder: Path) -> Iterator[list[dict[str, Any]]]:
    """Play chains 0 to `chains` - 1, and yield all results so far after each; resume from existing results.

    Raises
    ------
    EvaluationError
        The folder holds a stream of other settings, or a damaged line.
    """
    file = folder / "stream.jsonl"
    header = json.dumps(dataclasses.asdict(settings), sort_keys=True)
    results = _kept(file, header)
    folder.mkdir(parents=True, exist_ok=True)
    if not file.exists():
        file.write_text(header + "\n", encoding="utf-8")
    yield results
    if len(results) >= chains:
        return
    stream = Stream(settings, folder)
    for index in range(len(results), chains):
        results.append(stream.play(index))
        with file.open("a", encoding="utf-8") as opened:
            opened.write(json.dumps(results[-1]) + "\n")
        yield results


def _kept(file: Path, header: str) -> list[dict[str, Any]]:
    if not file.exists():
        return []
    first, *lines = read_text(file, _LARGEST).split("\n")
    if first != header:
        raise EvaluationError(
            f"{file}: expected a stream of these settings, got another: choose another --out"
        )
    try:
        results = [json.loads(line) for line in lines[:-1]]
    except ValueError as error:
        raise EvaluationError(f"{file}: expected a result in every line: {error}") from error
    if lines[-1]:  # it was cut off
        file.write_text("\n".join([first, *lines[:-1], ""]), encoding="utf-8")
    return results


def summary(results: Sequence[dict[str, Any]], after: int) -> dict[str, Any]:
    """Return gains over naive in s with intervals, of the chains from `after` on, and what else counts."""
    part = results[after:]
    gains = {name: _gains(part, name) for name in (*POLICIES[1:], ORACLE) if name in part[0]["durations"]}
    told: dict[str, Any] = {
        "chains": len(results),
        "from": after,
        "naive": {"mean_s": _mean(part, "naive"), "failed": _failed(part, "naive")},
    }
    for name, gain in gains.items():
        low, high = mean_interval(gain)
        told[name] = {"gain_s": float(gain.mean()), "ci95": [low, high], "failed": _failed(part, name)}
    limit = told["offline"]["gain_s"]
    told["share_of_offline"] = told["learning"]["gain_s"] / limit if limit > 0.0 else None
    low, high = mean_interval(gains["learning"] - gains["shipped"])
    told["learning_over_shipped_s"] = [float(np.mean(gains["learning"] - gains["shipped"])), low, high]
    told["sets"] = len({result["set"] for result in results} - {""})
    told["explored"] = results[-1]["explored"]
    return told


def _gains(results: Sequence[dict[str, Any]], policy: str) -> Any:
    return np.array([r["durations"]["naive"] - r["durations"][policy] for r in results])


def _mean(results: Sequence[dict[str, Any]], policy: str) -> float:
    return float(np.mean([result["durations"][policy] for result in results]))


def _failed(results: Sequence[dict[str, Any]], policy: str) -> int:
    return sum(policy in result["failed"] for result in results)


def table_text(summaries: dict[str, dict[str, Any]]) -> str:
    """Return summaries by change as a table for a terminal."""
    lines = [f"{'robot':10}{'policy':10}{'gain s':>9}{'95 %':>18}{'failed':>8}{'of offline':>12}"]
    for change, told in summaries.items():
        naive = told["naive"]
        lines.append(f"{change:10}{'naive':10}{'':>9}{'':>18}{naive['failed']:8}   {naive['mean_s']:.2f} s")
        for name in ("shipped", "learning", "offline", ORACLE):
            if name in told:
                low, high = told[name]["ci95"]
                share = told["share_of_offline"] if name == "learning" else None
                lines.append(
                    f"{'':10}{name:10}{told[name]['gain_s']:9.3f}{f'{low:.3f} to {high:.3f}':>18}"
                    f"{told[name]['failed']:8}{'' if share is None else f'{100 * share:.0f} %':>12}"
                )
    return "\n".join(lines)


def chart(streams: Mapping[str, Sequence[dict[str, Any]]]) -> Any:
    """Draw the mean gain over naive so far against the chains played, one panel for each robot."""
    figure = new_figure(3.2 * len(streams), 3.0)
    for number, (change, results) in enumerate(streams.items(), start=1):
        axes = figure.add_subplot(1, len(streams), number)
        for name, colour in _COLOURS.items():
            if name in results[0]["durations"]:
                gains = np.cumsum(_gains(results, name)) / np.arange(1, len(results) + 1)
                axes.plot(gains, color=colour, lw=1.4, label=name)
        switches = [i for i in range(1, len(results)) if results[i]["set"] != results[i - 1]["set"]]
        for index in switches:
            axes.axvline(index, color=GREY, lw=0.6, ls=":")
        axes.set_title(change)
        axes.set_xlabel("chains played")
        axes.set_ylabel("mean gain over naive, s")
        axes.legend(frameon=False)
    return figure
