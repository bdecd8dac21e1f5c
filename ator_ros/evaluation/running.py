"""A whole evaluation: parallel, resumable, with results that do not depend on the number of workers."""

from __future__ import annotations

import contextlib
import platform
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ator_ros.evaluation.errors import EvaluationError
from ator_ros.evaluation.situation import Record, Settings, evaluate_trial
from ator_ros.evaluation.statistics import outcomes, prediction_errors, summarise
from ator_ros.evaluation.storage import PartialResults
from ator_ros.experience.parallel import run_tasks
from ator_ros.experience.table import library_versions
from ator_ros.files import alone_in, reserved

RESUMES = "the same command goes on from here"
_RECORD_BYTES = 5000  # of a situation with every policy and 24 headings of the oracle; most have a fifth
_SPARE = 500_000  # bytes
Progress = Callable[[Iterable[Record], int, int], Iterable[Record]]


def run_situations(
    settings: Settings,
    *,
    situations: int,
    folder: Path,
    jobs: int = 1,
    backend: str = "loky",
    progress: Progress | None = None,
) -> list[Record]:
    """Evaluate situations 0 to `situations` - 1, except those whose results are already in `folder`.

    Parameters
    ----------
    settings : Settings
        Everything that the results depend on.
    situations : int
        Number of situations.
    folder : Path
        Folder of partial results, which should be this process's alone; see `results_in`.
    jobs, backend
        As for `ator_ros.experience.parallel.run_tasks`.
    progress : callable
        Called with the iterable of new records, the number of records there are, and the number there will
        be; returns an iterable of the same records.

    Raises
    ------
    EvaluationError
        The folder contains results of other settings, or the disk is full; finished situations are kept.
    OSError
        The folder cannot be written, or has no room for the results.
    BackendError
        The parallel backend cannot be used.
    """
    partial = PartialResults(folder, settings, settings.source.digest(settings.policies, settings.chain))
    tasks = [(settings, index) for index in range(situations) if index not in partial.records]
    results: Iterable[Record] = run_tasks(evaluate_trial, tasks, jobs=jobs, backend=backend)
    if progress is not None:
        results = progress(results, situations - len(tasks), situations)
    _keep(results, partial, folder, situations)
    return [partial.records[index] for index in range(situations)]


@contextlib.contextmanager
def results_in(folder: Path, situations: int) -> Iterator[None]:
    """Keep a folder of results, made when missing, from other processes; check its room before it is made.

    Raises
    ------
    OSError
        The folder cannot be written, has no room for the results, or another process writes there.
    """
    if not folder.exists():
        there = next(parent for parent in folder.absolute().parents if parent.exists())
        with reserved(there, _room_for(situations)):
            pass
    with alone_in(folder):
        yield


def _keep(results: Iterable[Record], partial: PartialResults, folder: Path, situations: int) -> None:
    """Keep each record as it comes; raises EvaluationError where the disk is full."""
    with reserved(folder, _room_for(situations - len(partial.records))) as release:
        for record in results:
            try:
                partial.append(record)
            except OSError as error:
                release()
                with contextlib.suppress(OSError):  # then this situation is executed again
                    partial.append(record)
                kept = f"{len(partial.records)} of {situations} situations are kept"
                raise EvaluationError(f"{partial.path}: {error.strerror}; {kept}, {RESUMES}") from error


def _room_for(situations: int) -> int:
    """Return the size of the results in bytes: the final report takes as much as the partial results."""
    return _SPARE + 2 * _RECORD_BYTES * situations


def describe(settings: Settings, records: Sequence[Record], command: str) -> dict[str, Any]:
    """Return the contents of `evaluation.json` except the runs."""
    summary: dict[str, Any] = {
        "situations": len(records),
        "seed": settings.seed,
        "command": command,
        **summarise(outcomes(records)),
    }
    for name, row in summary.items():
        if isinstance(row, dict) and "predicted" in records[0]["policies"].get(name, {}):
            row["prediction"] = prediction_errors(records, name)
    return {
        "summary": summary,
        "settings": portable(asdict(settings)),
        "executed": sum(record["executed"] for record in records),
        "digest": settings.source.digest(settings.policies, settings.chain),
        "digests": settings.source.digests(settings.chain),
        "versions": library_versions(),
        "machine": platform.platform(),
    }


def portable(settings: dict[str, Any]) -> dict[str, Any]:
    """Return settings without the folders of this machine."""
    source = settings["source"]
    source["robot"] = Path(source["robot"]).name
    source["models"] = Path(source["models"]).name
    source["experience"] = [Path(table).name for table in source["experience"]]
    return settings


def has_predictions(row: Any) -> bool:
    """Return whether a row of the summary contains errors of predictions."""
    return isinstance(row, Mapping) and row.get("prediction", {}).get("chains", 0) > 0
