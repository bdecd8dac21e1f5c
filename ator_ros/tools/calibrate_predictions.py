"""Learn corrections of predicted durations from chains that `evaluate` executed, or report errors."""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from ator_ros.evaluation.calibration_learning import (
    StepExample,
    cross_validated,
    fit_calibration,
    step_examples,
)
from ator_ros.evaluation.policies import POLICIES
from ator_ros.evaluation.running import RESULT, read_result, to_records
from ator_ros.evaluation.situation import Settings
from ator_ros.evaluation.toolset import Models, ToolsetSource, tools_of
from ator_ros.evaluation.trials import EvaluationError
from ator_ros.files import portable_command, read_json, write_text
from ator_ros.printable import short
from ator_ros.refinement.calibration import (
    CALIBRATION,
    Calibration,
    load_calibration_if_any,
    save_calibration,
)
from ator_ros.tools.command_line import add_models, add_setting, destination, guarded, parse, source_of


def calibrate_predictions(
    evaluations: Sequence[Path], source: ToolsetSource, *, command: str, actions: Sequence[str] | None = None
) -> None:
    """Learn corrections of predicted durations from evaluations, and write them beside the models.

    Parameters
    ----------
    evaluations : sequence of Path
        Folders that `evaluate` has written.
    source : ToolsetSource
        Robot and models; the action set is that of the evaluations.
    command : str
        The command line, for the file.
    actions : sequence of str, optional
        Learn the corrections of these only, and keep those of the others; by default all.
    """
    results = [(folder, read_result(folder / RESULT)) for folder in evaluations]
    sets = {result["settings"]["source"]["action_set"] for _, result in results}
    if len(sets) != 1:
        raise EvaluationError(f"expected evaluations of one action set, got {', '.join(sorted(sets))}")
    source = dataclasses.replace(source, action_set=sets.pop())
    tools, library = tools_of(source)
    for name in actions or ():
        if name not in tools.models:
            known = ", ".join(tools.models)
            raise EvaluationError(f"--actions: expected some of {known}, got {short(name)}")
    examples: list[StepExample] = []
    learned_from: list[dict[str, Any]] = []
    for folder, result in results:
        seed, chain = result["settings"]["seed"], result["settings"]["chain"]
        _check(folder / RESULT, result, source)
        records = to_records(result["runs"], result["summary"]["situations"])
        try:
            examples += step_examples(records, seed=seed, chain=chain, tools=tools, library=library)
        except EvaluationError as error:
            raise EvaluationError(f"{folder / RESULT}: {error}") from error
        learned_from.append({"seed": seed, "chain": chain, "situations": len(records)})
    models, path = tools.models, source.folder() / CALIBRATION
    kept = load_calibration_if_any(path.parent)

    def finish(fitted: Calibration) -> Calibration:
        return joined(kept, fitted, actions)

    training: dict[str, Any] = {"command": command, "chains": learned_from}
    if actions and path.exists():
        before = read_json(path).get("training", {})
        training["others"] = before.get("others", before)
    _learn(examples, models, path, training, finish)


def save_learned(
    examples: Sequence[StepExample], settings: Settings, *, situations: int, command: str
) -> None:
    """Learn corrections from the actions of executed chains, and write them beside the models.

    Raises
    ------
    EvaluationError
        There are too few examples.
    """
    chains = [{"seed": settings.seed, "chain": settings.chain, "situations": situations}]
    models, path = tools_of(settings.source)[0].models, settings.source.folder() / CALIBRATION
    _learn(examples, models, path, {"command": command, "chains": chains})


def _learn(
    examples: Sequence[StepExample],
    models: Models,
    path: Path,
    training: Mapping[str, Any],
    finish: Callable[[Calibration], Calibration] = lambda fitted: fitted,
) -> None:
    """Learn a calibration, `finish` it, write it with its `training`, and print its errors."""
    calibration = finish(fit_calibration(examples, models))
    checked = cross_validated(examples, models, finish)
    save_calibration(path, calibration, {**training, "cross_validation": checked})
    print(pd.DataFrame(checked).T.to_string())
    print(f"wrote {path}: {', '.join(calibration.shortfalls)}")


def joined(kept: Calibration, learned: Calibration, actions: Sequence[str] | None) -> Calibration:
    """Return the learned corrections; with `actions`, only theirs, and those `kept` of other actions.

    Raises
    ------
    EvaluationError
        An action has too few examples.
    """
    if actions is None:
        return learned
    for name in actions:
        if name not in learned.shortfalls:
            raise EvaluationError(f"--actions: {name}: expected chains of more situations, got too few")
    return Calibration({**kept.shortfalls, **{name: learned.shortfalls[name] for name in actions}})


def _check(file: Path, result: Mapping[str, Any], source: ToolsetSource) -> None:
    """Check that an evaluation used the same robot and models, for which alone corrections hold."""
    ours, found = source.digests(result["settings"]["chain"]), result.get("digests")
    if not isinstance(found, dict):
        raise EvaluationError(f"{file}: expected the digests of robot and models, got none: evaluate again")
    others = [name for name, digest in ours.items() if found.get(name) != digest]
    if others:
        raise EvaluationError(
            f"{file}: expected chains executed with the robot and the models of {source.folder()}, "
            f"got another {', another '.join(others)}: evaluate again"
        )


def prediction_report(results: Sequence[Mapping[str, Any]], command: str) -> str:
    """Return a Markdown page on the predictions of our policies in evaluations, as `read_result` reads them.

    Raises
    ------
    EvaluationError
        None of them holds predictions.
    """
    rows = [row for result in results for row in _rows(result)]
    if not rows:
        raise EvaluationError("expected evaluations with predictions of our policies: evaluate again")
    made = [f"    {result['summary']['command']}" for result in results]
    return "\n".join(
        [
            "# How far predictions are from what is executed",
            "",
            f"Made by `{command}` from what these have executed:",
            "",
            *made,
            "",
            "Mean of predicted minus actual duration over the chains that succeeded, with 95 % bootstrap",
            "intervals over situations, and the mean absolute error.",
            "",
            "| chain | seed | policy | chains | predicted - actual (s) | 95 % | MAE (s) |",
            "| --- | --- | --- | --- | --- | --- | --- |",
            *rows,
            "",
        ]
    )


def _rows(result: Mapping[str, Any]) -> Iterator[str]:
    """Yield a row for each policy with predictions."""
    chain, summary = result["settings"]["chain"], result["summary"]
    for name in POLICIES:
        errors = summary.get(name, {}).get("prediction", {})
        if errors.get("chains"):
            low, high = errors["mean_error_ci95"]
            yield (
                f"| {chain} | {summary['seed']} | {name} | {errors['chains']} "
                f"| {errors['mean_error_s']:+.3f} | {low:+.3f} to {high:+.3f} | {errors['mae_s']:.3f} |"
            )


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


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    options, _ = parse(arguments(), words)

    def run() -> None:
        command = portable_command("calibrate_predictions", words)
        if options.report:
            results = [read_result(folder / RESULT) for folder in options.evaluations]
            write_text(options.report, prediction_report(results, command))
            print(f"wrote {options.report}")
            return
        calibrate_predictions(
            options.evaluations, source_of(options), command=command, actions=options.actions
        )

    return guarded("calibrate_predictions", run)


if __name__ == "__main__":
    sys.exit(main())
