"""Evaluate refinement: execute the same random situations with every policy (paper, section 5, Table 1)."""

from __future__ import annotations

import argparse
import sys

from ator_ros.evaluation.again import former_records, joined, settings_again
from ator_ros.evaluation.errors import EvaluationError
from ator_ros.evaluation.policies import POLICIES
from ator_ros.evaluation.running import describe, results_in
from ator_ros.evaluation.situation import Record, Settings
from ator_ros.evaluation.storage import RESULT, PartialResults, read_result, write_result
from ator_ros.evaluation.toolset import available_policies, make_toolset, without_experience
from ator_ros.evaluation.worst_runs import worst_runs
from ator_ros.report.evaluation_page import write_report
from ator_ros.report.terminal_tables import evaluation_table, prediction_table
from ator_ros.tools.command_line import source_of
from ator_ros.tools.work.situations import executed


def run(options: argparse.Namespace, command: str) -> int:
    """Do what the command line asks for; return the exit code."""
    if options.situations < 1:
        raise EvaluationError(f"--situations: expected at least 1, got {options.situations}")
    source = source_of(options, experience=tuple(options.experience))
    source.require_executable(options.chain)
    tools = make_toolset(source)  # before anything is executed: a damaged file is reported at once
    source.digests(options.chain)
    policies, missing = available_policies(source)
    missing |= without_experience(tools, source, options.chain)
    for name, why in missing.items():
        if options.policies is None:
            print(f"evaluate: without the policy {name}: {why}", file=sys.stderr)
        elif name in options.policies:
            raise EvaluationError(f"--policies: {name} cannot be run: {why}")
    wanted = tuple(name for name in options.policies or policies if name not in missing)
    settings = Settings(
        seed=options.seed,
        chain=options.chain,
        policies=tuple(name for name in POLICIES if name in {*wanted, "naive"}),
        oracle=options.oracle,
        oracle_margin=options.oracle_margin,
        oracle_speeds=tuple(options.oracle_speeds),
        source=source,
        joint_oracle=options.oracle_jointly,
    )
    with results_in(options.out, options.situations):
        if options.again:
            records, command = _again(settings, options)
        else:
            records = executed(settings, options, options.out)
        result = describe(settings, records, command)
        path = write_result(options.out, result, records)
        print(evaluation_table(result["summary"]))
        print(prediction_table(result["summary"]))
        worst = worst_runs(records, tools, settings)
        report = write_report(options.out, result, records, settings, tools, worst)
        PartialResults.remove(options.out)
    print(f"wrote {path} and {report}")
    return 0


def _again(settings: Settings, options: argparse.Namespace) -> tuple[list[Record], str]:
    """Evaluate some policies of the result in `options.out` again; return all records, and its command."""
    unknown = [name for name in options.again if name not in settings.policies]
    if unknown:
        raise EvaluationError(
            f"--again: {unknown[0]} is not among --policies, so there is nothing to replace"
        )
    former = read_result(options.out / RESULT)
    kept = former_records(former, settings, options.situations)
    records = joined(kept, executed(settings_again(settings, options.again), options, options.out))
    return records, former["summary"]["command"]
