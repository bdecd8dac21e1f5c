"""Measure the actions: success, regularity, and time over the time-optimal motion."""

from __future__ import annotations

import argparse

from ator_ros.domains.domain import Domain
from ator_ros.domains.measurements import QualityRun
from ator_ros.evaluation.errors import EvaluationError
from ator_ros.tools.command_line import asked


def run(options: argparse.Namespace, domain: Domain, command: str) -> int:
    """Do what the command line asks for; return the exit code."""
    if domain.measurements.qualify is None:
        raise EvaluationError(
            f"domain: expected one with measurements.qualify, got {domain.name}: "
            "`study` measures the actions of any domain"
        )
    domain.measurements.qualify(asked(QualityRun, options, command))
    return 0
