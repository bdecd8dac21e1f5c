"""Streams of chains that are played in parts, and what they come to."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ator_ros.evaluation.errors import EvaluationError
from ator_ros.evaluation.statistics import mean_interval
from ator_ros.files import read_text
from ator_ros.learning.stream import ORACLE, POLICIES, Stream, StreamSettings

_LARGEST = 100_000_000


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
    stream = Stream(settings, folder, results[-1] if results else None)
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
