"""A whole evaluation: parallel, resumable, with results that do not depend on the number of workers."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import os
import platform
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tqdm import tqdm

from ator_ros.evaluation.situation import Record, Settings, evaluate_trial
from ator_ros.evaluation.statistics import outcomes, prediction_errors, summarise
from ator_ros.evaluation.trials import EvaluationError
from ator_ros.experience.parallel import cluster, run_tasks
from ator_ros.experience.table import library_versions
from ator_ros.files import FileError, alone_in, content_of, read_json, read_text, reserved, save, write_text
from ator_ros.schema import SchemaError, Within, structured

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

PARTIAL = "situations.jsonl"
RESULT = "evaluation.json"
KIND = "evaluation"
LARGEST = 1_000_000_000
"""Bytes of a file of results that is read."""
RESUMES = "the same command goes on from here"
_RECORD_BYTES = 5000  # of a situation with every policy and 24 headings of the oracle; most have a fifth
_SPARE = 500_000  # bytes


class PartialResults:
    """Records of single situations, appended one by one, so that an interrupted evaluation can resume.

    The first line holds what the records depend on, every other line a digest of it and of its record. A line
    that was cut off by a crash is forgotten.

    Parameters
    ----------
    folder : Path
        Where the file lies; it is made when missing.
    settings : dataclass
        Of this evaluation.
    digest : str
        Of everything else that the results depend on: robot, models, gate.

    Raises
    ------
    EvaluationError
        The folder holds results of other settings, or cannot be written.
    """

    def __init__(self, folder: Path, settings: DataclassInstance, digest: str) -> None:
        self.path = folder / PARTIAL
        identity = {"settings": dataclasses.asdict(settings), "digest": digest}
        self._header = json.dumps(identity, sort_keys=True)
        self.records: dict[int, Record] = {}
        try:
            folder.mkdir(parents=True, exist_ok=True)
            lines = read_text(self.path, LARGEST).split("\n") if self.path.exists() else []
        except (OSError, ValueError) as error:
            raise EvaluationError(f"{folder}: expected a folder for results: {error}") from error
        if len(lines) > 1 and lines[0] != self._header:
            raise EvaluationError(
                f"{self.path}: expected partial results of the same settings, models and gate, got others: "
                "choose another --out, or delete that file"
            )
        for number, line in enumerate(lines[1:-1], start=2):
            record = self._record(line, number)
            self.records[record["index"]] = record
        # Rewritten, which removes a line that was cut off.
        write_text(self.path, "\n".join([self._header, *lines[1:-1], ""]))

    def _record(self, line: str, number: int) -> Record:
        """Read a line that `append` wrote with the same settings and models."""
        try:
            data = json.loads(line)
            record: Record = data["record"]
            genuine = data["of"] == self._identity(record)
        except (ValueError, RecursionError, KeyError, TypeError):
            genuine = False
        if not genuine:
            raise EvaluationError(
                f"{self.path}: line {number}: expected a situation's record of these settings and models, "
                f"got a damaged or foreign line {line[:60]!r}: delete the line"
            )
        return record

    def _identity(self, record: Record) -> str:
        """Digest a record with the settings and models that it was made with."""
        text = self._header + json.dumps(record, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def append(self, record: Record) -> None:
        """Keep the record of one more situation, whole or not at all.

        Raises
        ------
        OSError
            The file cannot be written.
        """
        line = json.dumps({"of": self._identity(record), "record": record}, separators=(",", ":"))
        size = self.path.stat().st_size
        try:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(line + "\n")
        except OSError:
            os.truncate(self.path, size)
            raise
        self.records[record["index"]] = record

    @staticmethod
    def remove(folder: Path) -> None:
        """Delete the partial results in `folder`, once the finished ones are written."""
        (folder / PARTIAL).unlink(missing_ok=True)


def write_result(folder: Path, result: Mapping[str, Any], records: Sequence[Record]) -> Path:
    """Write `evaluation.json`: the contents of `result`, and all runs by columns, in one line."""
    path = folder / RESULT
    save(path, KIND, {**result, "runs": to_columns(records)}, compact=("runs",))
    return path


def to_columns(records: Sequence[Mapping[str, Any] | None]) -> dict[str, Any]:
    """Turn records into columns: each key to the list of its values, mappings key by key."""
    names = dict.fromkeys(name for record in records if record is not None for name in record)
    columns: dict[str, Any] = {}
    for name in names:
        values = [None if record is None else record.get(name) for record in records]
        nested = any(isinstance(value, Mapping) for value in values)
        columns[name] = to_columns(values) if nested else values
    return columns


def to_records(columns: Mapping[str, Any], count: int) -> list[Record]:
    """Turn columns that `to_columns` made back into records; what is missing is left out."""
    records: list[Record] = [{} for _ in range(count)]
    for name, values in columns.items():
        rows = to_records(values, count) if isinstance(values, Mapping) else values
        for record, value in zip(records, rows, strict=True):
            if value is not None and value != {}:
                record[name] = value
    return records


@dataclass(frozen=True)
class _Source:
    action_set: str


@dataclass(frozen=True)
class _Settings:
    seed: int
    chain: str
    source: _Source


@dataclass(frozen=True)
class _Summary:
    situations: Annotated[int, Within(0)]


@dataclass(frozen=True)
class _ResultFile:
    """The fields of `evaluation.json` that are used again; runs: records by columns."""

    summary: _Summary
    settings: _Settings
    runs: dict[str, Any]
    digests: dict[str, str] | None = None


def read_result(path: Path) -> dict[str, Any]:
    """Read `evaluation.json`.

    Raises
    ------
    EvaluationError
        The file cannot be read, or is no finished evaluation.
    """
    try:
        data = content_of(read_json(path, largest=LARGEST), KIND)
        structured(data, _ResultFile)
    except FileError as error:
        raise EvaluationError(str(error)) from error
    except SchemaError as error:
        raise EvaluationError(f"{path}: {error}") from error
    return data


def run_situations(
    settings: Settings,
    *,
    situations: int,
    folder: Path,
    jobs: int = 1,
    backend: str = "loky",
    scheduler: str | None = None,
) -> list[Record]:
    """Evaluate situations 0 to `situations` - 1, except those whose results are already in `folder`.

    The same call resumes where it was interrupted. A progress bar is shown on a terminal.

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
    scheduler : str, optional
        Address of a Dask scheduler, see `ator_ros.experience.parallel.cluster`.

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
    done = situations - len(tasks)
    with cluster(scheduler):
        results = run_tasks(evaluate_trial, tasks, jobs=jobs, backend=backend)
        bar = tqdm(results, initial=done, total=situations, unit="situation", smoothing=0.05, disable=None)
        _keep(bar, partial, folder, situations)
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
    return settings


def has_predictions(row: Any) -> bool:
    """Return whether a row of the summary contains errors of predictions."""
    return isinstance(row, Mapping) and row.get("prediction", {}).get("chains", 0) > 0
