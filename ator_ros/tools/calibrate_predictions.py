"""Learn corrections of predicted durations from chains that `evaluate` executed, or report errors."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from ator_ros.domains.domain import Domain
from ator_ros.evaluation.calibration_learning import (
    StepExample,
    cross_validated,
    fit_calibration,
    step_examples,
)
from ator_ros.evaluation.policies import POLICIES
from ator_ros.evaluation.running import RESULT, Result, read_result, to_records
from ator_ros.evaluation.toolset import ToolsetSource, tools_of
from ator_ros.evaluation.trials import EvaluationError
from ator_ros.files import read_json, write_text
from ator_ros.printable import quoted
from ator_ros.refinement.calibration import CALIBRATION, load_calibration_if_any, save_calibration
from ator_ros.tools.command_line import add_models, add_setting, destination, run_tool, source_of


def calibrate_predictions(
    evaluations: Sequence[Path], source: ToolsetSource, *, command: str, actions: Sequence[str] | None = None
) -> None:
    """Learn corrections of predicted durations from folders of `evaluate`; write them beside the models.

    `source` is that of robot and models; the action set is that of the evaluations. With `actions`, those of
    other actions are kept. `command` is the command line, for the file.
    """
    results = [(folder, read_result(folder)) for folder in evaluations]
    sets = {result.settings["source"]["action_set"] for _, result in results}
    if len(sets) != 1:
        raise EvaluationError(f"expected evaluations of one action set, got {', '.join(sorted(sets))}")
    source = dataclasses.replace(source, action_set=sets.pop())
    tools, library = tools_of(source)
    for name in actions or ():
        if name not in tools.models:
            known = ", ".join(tools.models)
            raise EvaluationError(f"--actions: expected some of {known}, got {quoted(name)}")
    examples: list[StepExample] = []
    learned_from: list[dict[str, Any]] = []
    for folder, result in results:
        seed, chain = result.settings["seed"], result.settings["chain"]
        _check(folder / RESULT, result, source)
        records = to_records(result.runs, result.summary["situations"])
        examples += step_examples(records, seed=seed, chain=chain, tools=tools, library=library)
        learned_from.append({"seed": seed, "chain": chain, "situations": len(records)})
    training: dict[str, Any] = {"command": command, "chains": learned_from}
    path = source.folder() / CALIBRATION
    if actions and path.exists():
        before = read_json(path).get("training", {})
        training["others"] = before.get("others", before)
    kept = load_calibration_if_any(source.folder()).shortfalls
    save_learned(examples, source, training, actions=actions, kept=kept)


def save_learned(
    examples: Sequence[StepExample], source: ToolsetSource, training: Mapping[str, Any], **others: Any
) -> None:
    """Learn a calibration, write it beside the models of `source`, and print its errors.

    `training` says how it is learned, for the file; `others` are further arguments of `fit_calibration`.
    """
    models, path = tools_of(source)[0].models, source.folder() / CALIBRATION
    calibration = fit_calibration(examples, models, **others)
    checked = cross_validated(examples, models, **others)
    save_calibration(path, calibration, {**training, "cross_validation": checked})
    print(pd.DataFrame(checked).T.to_string())
    print(f"wrote {path}: {', '.join(calibration.shortfalls)}")


def _check(file: Path, result: Result, source: ToolsetSource) -> None:
    """Check that an evaluation used the same robot and models, for which alone corrections hold."""
    ours = source.digests(result.settings["chain"])
    others = [name for name, digest in ours.items() if result.digests.get(name) != digest]
    if others:
        raise EvaluationError(
            f"{file}: expected chains executed with the robot and the models of {source.folder()}, "
            f"got another {', another '.join(others)}: evaluate again"
        )


def prediction_report(results: Sequence[Result], command: str) -> str:
    """Return a Markdown page on the predictions of our policies in evaluations, as `read_result` reads them.

    Raises
    ------
    EvaluationError
        None of them holds predictions.
    """
    rows = [
        (result.settings["chain"], result.summary["seed"], name, errors)
        for result in results
        for name in POLICIES
        if (errors := result.summary.get(name, {}).get("prediction", {})).get("chains")
    ]
    if not rows:
        raise EvaluationError("expected evaluations with predictions of our policies: evaluate again")
    lines = [
        "# How far predictions are from what is executed",
        "",
        f"Made by `{command}` from what these have executed:",
        "",
        *(f"    {result.summary['command']}" for result in results),
        "",
        "Mean of predicted minus actual duration over the chains that succeeded, with 95 % bootstrap",
        "intervals over situations, and the mean absolute error.",
        "",
        "| chain | seed | policy | chains | predicted - actual (s) | 95 % | MAE (s) |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for chain, seed, name, errors in rows:
        low, high = errors["mean_error_ci95"]
        lines.append(
            f"| {chain} | {seed} | {name} | {errors['chains']} "
            f"| {errors['mean_error_s']:+.3f} | {low:+.3f} to {high:+.3f} | {errors['mae_s']:.3f} |"
        )
    return "\n".join([*lines, ""])


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `calibrate_predictions`."""
    parser = argparse.ArgumentParser(prog="calibrate_predictions", description=__doc__)
    parser.add_argument(
        "evaluations",
        nargs="+",
        type=Path,
        metavar="DIR",
        help="folders that evaluate has written, with the policies naive, refined, refined_speed",
    )
    add_setting(parser, action_set=False)
    add_models(parser)
    parser.add_argument(
        "--actions",
        nargs="+",
        metavar="NAME",
        help="learn the corrections of these actions only; the file keeps those of the others (default: all)",
    )
    parser.add_argument(
        "--report",
        type=destination,
        metavar="FILE.md",
        help="write how far the predictions in these evaluations were off, and learn nothing",
    )
    return parser


def _run(options: argparse.Namespace, _: Domain, command: str) -> None:
    if not options.report:
        calibrate_predictions(
            options.evaluations, source_of(options), command=command, actions=options.actions
        )
        return
    results = [read_result(folder) for folder in options.evaluations]
    write_text(options.report, prediction_report(results, command))
    print(f"wrote {options.report}")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    return run_tool(arguments(), _run, argv)
