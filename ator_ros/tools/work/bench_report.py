"""The report of `bench`: for each part its rows by case, and when and where they were measured."""

from __future__ import annotations

import dataclasses
import os
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from ator_ros.domains.measurements import LongestTick, PlannedPoints
from ator_ros.experience.table import library_versions
from ator_ros.formats import Format
from ator_ros.schema import unstructured
from ator_ros.tools.benchmarks.rows import (
    CollectionTime,
    DelayedTrip,
    LongChainTime,
    MeasuredLearner,
    NotRun,
    PlanTime,
    RefinementTime,
    Requirements,
    RoundTrip,
    ServiceTime,
    SimulationSpeed,
)

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

FORMAT = Format("ator_ros benchmarks", 1, "report of bench")
Row = TypeVar("Row", bound="DataclassInstance")


@dataclass(frozen=True)
class MeasuringMachine:
    """When and where a part was measured: time, processor, cores, load of 1, 5 and 15 minutes, software."""

    begun: str
    processor: str
    cores: int | None
    load_at_start: tuple[float, ...]
    system: str
    versions: dict[str, str]


@dataclass(frozen=True)
class BenchReport:
    """The content of the file that `bench` writes: the parts by name, None where not measured yet.

    Each part has its rows by the name of the case; `measured` has the machine by the name of the part.
    """

    simulation: dict[str, SimulationSpeed] | None = None
    planning: dict[str, LongestTick | PlannedPoints] | None = None
    refinement: dict[str, RefinementTime | LongChainTime] | None = None
    plans: dict[str, PlanTime] | None = None
    service: dict[str, ServiceTime | RoundTrip | DelayedTrip] | None = None
    collection: dict[str, CollectionTime] | None = None
    learners: dict[str, MeasuredLearner | NotRun | Requirements] | None = None
    measured: dict[str, MeasuringMachine] = field(default_factory=dict)

    def with_part(
        self, name: str, rows: Mapping[str, DataclassInstance], where: MeasuringMachine
    ) -> BenchReport:
        """Return the report with the rows of a part, judged, in place of those that it had."""
        part: Any = {case: judged(row) for case, row in rows.items()}
        return dataclasses.replace(self, **{name: part}, measured={**self.measured, name: where})

    def lines(self, part: str) -> list[str]:
        """Return a part as lines of a table: one for each case, the numbers by name."""
        rows: Mapping[str, DataclassInstance] = getattr(self, part) or {}
        return [
            f"{part:11} {case:34} "
            + "  ".join(f"{name} {_shown(value)}" for name, value in unstructured(row).items())
            for case, row in rows.items()
        ]


def judged(row: Row) -> Row:
    """Return a row with `met`: whether it keeps its limits; unchanged where it has none.

    A limit of speed ("times_…") is a least value, the others are greatest ones; "limit_ms" is the median's.
    """
    figures = unstructured(row)
    limits = {
        name.removeprefix("limit_"): value for name, value in figures.items() if name.startswith("limit_")
    }
    kept = []
    for name, limit in limits.items():
        value = figures["median_ms" if name == "ms" else name]
        kept.append(value >= limit if name.startswith("times_") else value <= limit)
    changes: dict[str, Any] = {"met": all(kept)} if kept else {}
    return dataclasses.replace(row, **changes)


def _shown(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:g}"


def measuring_machine() -> MeasuringMachine:
    """Describe this machine and the present load."""
    return MeasuringMachine(
        begun=datetime.now(UTC).isoformat(timespec="seconds"),
        processor=_processor(),
        cores=os.cpu_count(),
        load_at_start=tuple(round(load, 2) for load in os.getloadavg()),
        system=platform.platform(),
        versions=library_versions(),
    )


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()
