"""Measure speeds and learners against their limits.

The parts: simulation, planning (the longest ticks), refinement (the core's), plans (from goals),
service, collection (of experience), and learners: our model tree beside others on the same rows.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ator_ros.domains.domain import find_domain
from ator_ros.domains.measurements import Rows
from ator_ros.experience.table import library_versions
from ator_ros.files import UnreadableError, read_json, write_text
from ator_ros.formats import Format
from ator_ros.schema import SchemaError
from ator_ros.tools.benchmarks import collection, learners, plans, refinement, simulation


def _planning(_: argparse.Namespace) -> Rows:
    domain = find_domain()
    if domain.measurements.longest_ticks is None:
        raise RuntimeError(f"expected a domain with measurements.longest_ticks, got {domain.name}")
    return domain.measurements.longest_ticks()


def _service(_: argparse.Namespace) -> dict[str, Any]:
    try:
        from ator_ros.tools.benchmarks import service
    except ImportError as error:
        raise RuntimeError(f"{error}: source your ROS 2 workspace, or use make bench") from error
    return service.measure()


def _learners(options: argparse.Namespace) -> dict[str, Any]:
    tables = {"experience": options.experience, "fresh": options.fresh}
    load = os.getloadavg()[0]
    cases = learners.measure(tables)
    write_text(options.out.with_name("peers.md"), learners.document(cases, load))
    return cases


FORMAT = Format("ator_ros benchmarks", 1, "report of bench")
PARTS: Mapping[str, Callable[[argparse.Namespace], Mapping[str, Any]]] = {
    "simulation": lambda _: simulation.measure(),
    "planning": _planning,
    "refinement": lambda _: refinement.measure(),
    "plans": lambda _: plans.measure(),
    "service": _service,
    "collection": lambda _: collection.measure(),
    "learners": _learners,
}


def run(options: argparse.Namespace) -> int:
    """Measure the parts that the command line names; the exit code is 1 where one cannot be."""
    try:
        report = FORMAT.current(read_json(options.out)) if options.out.exists() else FORMAT.head()
        for part in options.parts:
            where = machine()
            report[part] = {case: {**row, **met(row)} for case, row in PARTS[part](options).items()}
            report.setdefault("measured", {})[part] = where
            print("\n".join(rows(part, report[part])), flush=True)
            write_text(options.out, FORMAT.text(report))
    except UnreadableError as error:
        print(f"bench: {error}", file=sys.stderr)
        return 1
    except SchemaError as error:
        print(f"bench: {options.out}: {error}", file=sys.stderr)
        return 1
    except RuntimeError as error:
        print(f"bench: {part}: {error}", file=sys.stderr)
        return 1
    print(f"written: {options.out}")
    return 0


def met(row: Mapping[str, float]) -> dict[str, bool]:
    """Return whether a row is within its limits; nothing where it has none.

    A limit of speed ("times_…") is a least value, the others are greatest ones; "limit_ms" is the median's.
    """
    limits = {name.removeprefix("limit_"): value for name, value in row.items() if name.startswith("limit_")}
    kept = []
    for name, limit in limits.items():
        value = row["median_ms" if name == "ms" else name]
        kept.append(value >= limit if name.startswith("times_") else value <= limit)
    return {"met": all(kept)} if kept else {}


def rows(part: str, results: Mapping[str, Mapping[str, float | str]]) -> list[str]:
    """Return the lines of a part of the table: one for each case, the numbers by name."""
    return [
        f"{part:11} {case:34} " + "  ".join(f"{name} {_shown(value)}" for name, value in row.items())
        for case, row in results.items()
    ]


def _shown(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:g}"


def machine() -> dict[str, Any]:
    """Describe when and where a part is measured: processor, cores, load, versions."""
    return {
        "begun": datetime.now(UTC).isoformat(timespec="seconds"),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "load_at_start": [round(load, 2) for load in os.getloadavg()],
        "system": platform.platform(),
        "versions": library_versions(),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()
