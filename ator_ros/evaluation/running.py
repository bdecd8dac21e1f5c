"""A whole evaluation: its situations in parallel, resumable, and the file of its results."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from ator_ros.evaluation.comparison import Record, Settings, evaluate_trial
from ator_ros.evaluation.statistics import prediction_errors, summarize
from ator_ros.experience.json_lines import PartialResults
from ator_ros.experience.parallel import progress, run_tasks
from ator_ros.experience.table import library_versions
from ator_ros.files import FileError, load, save

PARTIAL = "situations.jsonl"
RESULT = "evaluation.json"
KIND = "evaluation"


def to_columns(records: Sequence[Mapping[str, Any] | None]) -> dict[str, Any]:
    """Convert records to columns: the list of values of each key.

    Values that are mappings become columns themselves. A missing value is None.
    """
    names = dict.fromkeys(name for record in records if record is not None for name in record)
    columns: dict[str, Any] = {}
    for name in names:
        values = [None if record is None else record.get(name) for record in records]
        nested = any(isinstance(value, Mapping) for value in values)
        columns[name] = to_columns(values) if nested else values
    return columns


def run_situations(
    settings: Settings,
    *,
    situations: int,
    folder: Path,
) -> list[Record]:
    """Evaluate situations 0 to `situations` - 1 in parallel.

    Results of an interrupted call in `folder` are used.

    Returns
    -------
    list of dict
        The record of each situation, see `evaluate_trial`.

    Raises
    ------
    FileError
        The folder contains results of other settings, or another process writes there.
    OSError
        The folder cannot be written; finished situations are kept.
    BackendError
        A worker process was killed.
    """
    identity = {"settings": asdict(settings), "digest": settings.source.digest()}
    expected = "results of the same settings and models"
    with PartialResults(folder / PARTIAL, identity, expected) as partial:
        try:
            records = {record["index"]: record for record in partial.results}
        except (LookupError, TypeError) as error:
            raise FileError(f"{partial.path}: expected {expected}, one a line") from error
        tasks = [(settings, index) for index in range(situations) if index not in records]
        results = progress(
            run_tasks(evaluate_trial, tasks),
            done=situations - len(tasks),
            total=situations,
            unit="situation",
        )
        for record in results:
            partial.append(record)
            records[record["index"]] = record
    return [records[index] for index in range(situations)]


def earlier_oracle(
    folder: Path,
    settings: Settings,
    situations: int,
) -> list[Record]:
    """Return the oracle's records of the first `situations` of an earlier evaluation.

    Raises
    ------
    FileError
        `evaluation.json` in `folder` cannot be read, has no oracle or too few situations, or its
        seed, chain, domain, action set, robot or map are not those of `settings`.
    """
    file = folder / RESULT
    earlier = load(file, KIND, dict[str, Any])
    try:
        theirs = _situations_of(earlier["settings"])
        runs = earlier["runs"]
        columns = {name: runs[name] for name in ("oracle", "oracle_speed") if name in runs}
        for oracle in columns.values():
            np.array([oracle["best"], oracle["success"]], dtype=float)
        lengths = [len(values) for oracle in columns.values() for values in oracle.values()]
    except (AttributeError, LookupError, TypeError, ValueError) as error:
        raise FileError(f"{file}: expected settings and runs of an evaluation") from error
    ours = _situations_of(asdict(_portable(settings)))
    if theirs != ours:
        raise FileError(f"{file}: expected an evaluation of {ours}, got {theirs}")
    found = min(lengths) if "oracle" in columns else 0
    if found < situations:
        raise FileError(
            f"{file}: expected an oracle of at least {situations} situations, got {found}"
        )
    return [_record_at(index, columns) for index in range(situations)]


def _situations_of(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings that determine the situations, and so the oracle."""
    found = {name: settings[name] for name in ("seed", "chain")}
    for name in ("domain", "action_set", "robot", "map"):
        found[name] = settings["source"].get(name, "")
    return found


def _record_at(index: int, columns: Mapping[str, Mapping[str, Any]]) -> Record:
    record: Record = {}
    for name, column in columns.items():
        record[name] = {key: values[index] for key, values in column.items()}
    return record


def _portable(settings: Settings) -> Settings:
    """Return the settings with names of files instead of paths."""
    source = settings.source
    names = {name: Path(getattr(source, name)).name for name in ("robot", "map", "models")}
    return replace(settings, source=replace(source, **names))


def write_result(
    folder: Path, settings: Settings, records: Sequence[Record], command: str
) -> dict[str, Any]:
    """Write `evaluation.json` to a folder and return its contents.

    Parameters
    ----------
    folder : Path
        The folder; it exists.
    settings : Settings
        What was evaluated.
    records : sequence of dict
        Results of all situations; they are written by columns in one line.
    command : str
        The command that repeats the evaluation.
    """
    summary: dict[str, Any] = {
        "situations": len(records),
        "seed": settings.seed,
        "command": command,
    }
    summary |= summarize(records)
    for name in settings.policies:
        if "predicted" in records[0]["policies"][name]:
            summary[name]["prediction"] = prediction_errors(records, name)
    result = {
        "summary": summary,
        "settings": asdict(_portable(settings)),
        "executed": sum(record["executed"] for record in records),
        "digest": settings.source.digest(),
        "versions": library_versions(),
        "machine": platform.platform(),
        "runs": to_columns(records),
    }
    save(folder / RESULT, KIND, result, compact=("runs",))
    return result
