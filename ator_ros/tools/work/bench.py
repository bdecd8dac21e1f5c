"""Measure speeds and learners against their limits.

The parts: simulation, planning (the longest ticks), refinement (the core's), plans (from goals),
service, collection (of experience), and learners: our model tree beside others on the same rows.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ator_ros.domains.domain import find_domain
from ator_ros.domains.measurements import Ticks
from ator_ros.evaluation.toolset import ToolsetSource
from ator_ros.files import UnreadableError, read_json, write_text
from ator_ros.schema import SchemaError, structured, unstructured
from ator_ros.tools.benchmarks import collection, learners, plans, refinement, simulation
from ator_ros.tools.work.bench_report import FORMAT, BenchReport, measuring_machine

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def _planning(source: ToolsetSource, _: argparse.Namespace) -> Ticks:
    domain = find_domain(source.domain)
    if domain.measurements.longest_ticks is None:
        raise RuntimeError(f"expected a domain with measurements.longest_ticks, got {domain.name}")
    return domain.measurements.longest_ticks(source.described())


def _service(_: ToolsetSource, __: argparse.Namespace) -> Mapping[str, DataclassInstance]:
    try:
        from ator_ros.tools.benchmarks import service
    except ImportError as error:
        raise RuntimeError(f"{error}: source your ROS 2 workspace, or use make bench") from error
    return service.measure()


def _learners(source: ToolsetSource, options: argparse.Namespace) -> learners.Cases:
    tables = {"experience": options.experience, "fresh": options.fresh}
    load = os.getloadavg()[0]
    cases = learners.measure(source, tables)
    write_text(options.out.with_name("peers.md"), learners.document(cases, load))
    return cases


PARTS: Mapping[str, Callable[[ToolsetSource, argparse.Namespace], Mapping[str, DataclassInstance]]] = {
    "simulation": lambda source, _: simulation.measure(source),
    "planning": _planning,
    "refinement": lambda source, _: refinement.measure(source),
    "plans": lambda source, _: plans.measure(source),
    "service": _service,
    "collection": lambda source, _: collection.measure(source),
    "learners": _learners,
}


def run(options: argparse.Namespace) -> int:
    """Measure the parts that the command line names; the exit code is 1 where one cannot be."""
    source = ToolsetSource()  # the default domain and robot, in every part
    try:
        report = _begun(options.out)
        for part in options.parts:
            where = measuring_machine()
            report = report.with_part(part, PARTS[part](source, options), where)
            print("\n".join(report.lines(part)), flush=True)
            write_text(options.out, FORMAT.text(unstructured(report)))
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


def _begun(file: Path) -> BenchReport:
    """Return the report that is there; an empty one where there is none."""
    if not file.exists():
        return BenchReport()
    return structured(FORMAT.content(read_json(file)), BenchReport, closed=True)
