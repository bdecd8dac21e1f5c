"""Soak the nodes: run chains for a set time, and report how the end compares with the beginning."""

from __future__ import annotations

import argparse
import json
import sys

from ator_ros.domains.domain import Domain
from ator_ros.files import write_text
from ator_ros.schema import unstructured
from ator_ros.tools.work.soak_report import Soak, report_of
from ator_ros.tools.work.soak_result import FORMAT, SoakReport
from ator_ros.tools.work.soak_run import run_soak


def run(options: argparse.Namespace, domain: Domain, command: str) -> int:
    """Do what the command line asks for; the exit code is 1 where something is worse than it should be."""

    def reported(soak: Soak) -> SoakReport:
        return report_of(soak, command, real_time=options.real_time_factor == 1.0)

    def write(soak: Soak) -> None:
        if soak.answers:
            write_text(options.out, FORMAT.text(unstructured(reported(soak))))

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
    report = reported(soak)
    print(json.dumps(unstructured(report), indent=1))
    return 1 if report.worse else 0
