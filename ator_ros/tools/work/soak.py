"""Soak the nodes: run chains for a set time, and report how the end compares with the beginning."""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
from typing import Any

from ator_ros.domains.domain import Domain
from ator_ros.experience.table import library_versions
from ator_ros.files import write_text
from ator_ros.formats import Format
from ator_ros.tools.work.soak_report import MEANING, Soak, summary
from ator_ros.tools.work.soak_run import run_soak

FORMAT = Format("ator_ros soak", 1, "report of a soak")


def report_of(soak: Soak, options: argparse.Namespace, command: str) -> dict[str, Any]:
    """Return the report to write, also during the run; it explains its own entries."""
    return {
        "command": command,
        "machine": f"{os.cpu_count()} cores, {platform.machine()}, {platform.system()}",
        "versions": library_versions(),
        "meaning": MEANING,
        **summary(soak, real_time=options.real_time_factor == 1.0),
    }


def run(options: argparse.Namespace, domain: Domain, command: str) -> int:
    """Do what the command line asks for; the exit code is 1 where something is worse than it should be."""

    def write(soak: Soak) -> None:
        if soak.answers:
            write_text(options.out, FORMAT.text(report_of(soak, options, command)))

    try:
        soak = run_soak(options, domain, write=write)
    except ImportError as error:
        print(f"soak: {error}: source your ROS 2 workspace, or use make run", file=sys.stderr)
        return 1
    except (RuntimeError, OSError) as error:  # a node that has ended is one
        print(f"soak: {error}", file=sys.stderr)
        return 1
    if not soak.answers:
        print(
            f"soak: expected chains after the warm-up, {options.duration:g} s are too short", file=sys.stderr
        )
        return 1
    report = report_of(soak, options, command)
    print(json.dumps(report, indent=1))
    return 1 if report["worse"] else 0
