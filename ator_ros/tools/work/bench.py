"""Measure the parts of `bench`, each in a module of its name, against their limits."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ator_ros.evaluation.toolset import ToolsetSource
from ator_ros.files import FileError, read_json, write_text
from ator_ros.schema import SchemaError, structured, unstructured
from ator_ros.tools.benchmarks import learners
from ator_ros.tools.work.bench_report import FORMAT, BenchReport, measuring_machine

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def measured(
    part: str, source: ToolsetSource, options: argparse.Namespace
) -> Mapping[str, DataclassInstance]:
    """Return the rows of a part by case: what `measure` of the module of its name returns.

    Raises
    ------
    RuntimeError
        It cannot be measured here.
    """
    if part == "learners":
        return _learners(source, options)
    try:
        module = importlib.import_module(f"ator_ros.tools.benchmarks.{part}")
    except ImportError as error:
        raise RuntimeError(f"{error}: source your ROS 2 workspace, or use make bench") from error
    rows: Mapping[str, DataclassInstance] = module.measure(source)
    return rows


def _learners(source: ToolsetSource, options: argparse.Namespace) -> learners.Cases:
    tables = {"experience": options.experience, "fresh": options.fresh}
    load = os.getloadavg()[0]
    cases = learners.measure(source, tables)
    write_text(options.out.with_name("peers.md"), learners.document(cases, load))
    return cases


def run(options: argparse.Namespace) -> int:
    """Measure the parts that the command line names; the exit code is 1 where one cannot be."""
    source = ToolsetSource()  # the default domain and robot, in every part
    try:
        report = _begun(options.out)
        for part in options.parts:
            where = measuring_machine()
            report = report.with_part(part, measured(part, source, options), where)
            print("\n".join(report.lines(part)), flush=True)
            write_text(options.out, FORMAT.text(unstructured(report)))
    except FileError as error:
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
