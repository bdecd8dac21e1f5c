"""A whole evaluation: parallel, resumable, with results that do not depend on the number of workers."""

from __future__ import annotations

import dataclasses
import json
import platform
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tqdm import tqdm

from ator_ros.evaluation.situation import Record, Settings, evaluate_trial
from ator_ros.evaluation.statistics import outcomes, prediction_errors, summarise
from ator_ros.evaluation.trials import EvaluationError
from ator_ros.experience.parallel import cluster, run_tasks
from ator_ros.experience.table import library_versions
from ator_ros.files import FileError, content_of, read_json, read_text, save, write_text
from ator_ros.schema import SchemaError, structured

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

PARTIAL = "situations.jsonl"
RESULT = "evaluation.json"
KIND = "evaluation"
LARGEST = 1_000_000_000
"""Bytes of a file of results that is read."""


class PartialResults:
    """Records of single situations, appended one by one, so that an interrupted evaluation can resume.

    The first line holds what the records depend on. A last line that a crash cut off is forgotten.

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
        The folder holds results of other settings, a line is damaged, or the file cannot be written.
    """

    def __init__(self, folder: Path, settings: DataclassInstance, digest: str) -> None:
        self.path = folder / PARTIAL
        header = json.dumps({"settings": dataclasses.asdict(settings), "digest": digest}, sort_keys=True)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            lines = read_text(self.path, LARGEST).split("\n")[:-1] if self.path.exists() else []
            found = [json.loads(line) for line in lines[1:]]
            self.records: dict[int, Record] = {record["index"]: record for record in found}
        except (OSError, ValueError, TypeError, KeyError) as error:
            raise EvaluationError(f"{self.path}: expected partial results, got {error}") from error
        if lines and lines[0] != header:
            raise EvaluationError(
                f"{self.path}: expected partial results of the same settings, models and gate, got others: "
                "choose another --out, or delete that file"
            )
        write_text(self.path, "\n".join([header, *lines[1:], ""]))  # without a line that was cut off

    def append(self, record: Record) -> None:
        """Keep the record of one more situation; OSError if the file cannot be written."""
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(record, separators=(",", ":")) + "\n")
        self.records[record["index"]] = record


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
class _ResultFile:
    """The fields of `evaluation.json` that are used again; runs: records by columns."""

    summary: dict[str, Any]
    settings: dict[str, Any]
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

    The same call resumes where it was interrupted. A progress bar is shown on a
    terminal, and a line of it in a log every 30 s.

    Parameters
    ----------
    settings : Settings
        Everything that the results depend on.
    situations : int
        Number of situations.
    folder : Path
        Folder of partial results, which should be this process's alone; see `ator_ros.files.alone_in`.
    jobs, backend
        As for `ator_ros.experience.parallel.run_tasks`.
    scheduler : str, optional
        Address of a Dask scheduler, see `ator_ros.experience.parallel.cluster`.

    Raises
    ------
    EvaluationError
        The folder contains results of other settings.
    OSError
        The folder cannot be written; finished situations are kept.
    BackendError
        The parallel backend cannot be used.
    """
    partial = PartialResults(folder, settings, settings.source.digest(settings.policies, settings.chain))
    tasks = [(settings, index) for index in range(situations) if index not in partial.records]
    done = situations - len(tasks)
    with cluster(scheduler):
        results = run_tasks(evaluate_trial, tasks, jobs=jobs, backend=backend)
        often = 0.1 if sys.stderr.isatty() else 30.0  # s; a log gets a line now and then
        pace = {"mininterval": often, "delay": often - 0.1}
        for record in tqdm(results, initial=done, total=situations, unit="situation", **pace):
            partial.append(record)
    return [partial.records[index] for index in range(situations)]


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
    return {**settings, "source": {**source, **{key: Path(source[key]).name for key in ("robot", "models")}}}
