"""Learn, or report, what predictions of actions in chains miss, from the chains that `evaluate` executed."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ator_ros.domains.domain import Domain
from ator_ros.evaluation.calibration_learning import (
    StepExample,
    cross_validated,
    fit_calibration,
    step_examples,
)
from ator_ros.evaluation.errors import EvaluationError
from ator_ros.evaluation.policies import Models
from ator_ros.evaluation.situation import Settings
from ator_ros.evaluation.storage import RESULT, read_result, to_records
from ator_ros.evaluation.toolset import ToolsetSource, tools_of
from ator_ros.files import read_json, write_text
from ator_ros.printable import short
from ator_ros.refinement.calibration import (
    CALIBRATION,
    Calibration,
    load_calibration_if_any,
    save_calibration,
)
from ator_ros.report.prediction_report import prediction_report
from ator_ros.tools.command_line import source_of


def run(options: argparse.Namespace, domain: Domain, command: str) -> int:
    """Do what the command line asks for; return the exit code."""
    results = [(folder, read_result(folder / RESULT)) for folder in options.evaluations]
    if options.report:
        write_text(options.report, prediction_report([result for _, result in results], command))
        print(f"wrote {options.report}")
        return 0
    sets = {result["settings"]["source"]["action_set"] for _, result in results}
    if len(sets) != 1:
        raise EvaluationError(f"expected evaluations of one action set, got {', '.join(sorted(sets))}")
    source = source_of(options, domain=domain.name, action_set=sets.pop())
    tools, library = tools_of(source)
    for name in options.actions or ():
        if name not in tools.models["learned"]:
            known = ", ".join(tools.models["learned"])
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
    models, path = tools.models["learned"], source.folder() / CALIBRATION
    kept = load_calibration_if_any(path.parent)

    def finish(fitted: Calibration) -> Calibration:
        return joined(kept, fitted, options.actions)

    training: dict[str, Any] = {"command": command, "chains": learned_from}
    if options.actions and path.exists():
        before = read_json(path).get("training", {})
        training["others"] = before.get("others", before)
    _learn(examples, models, path, training, finish)
    return 0


def save_learned(
    examples: Sequence[StepExample], settings: Settings, *, situations: int, command: str
) -> None:
    """Learn what predictions miss from executed actions of so many situations; write it beside the models.

    Raises
    ------
    EvaluationError
        There are too few.
    """
    chains = [{"seed": settings.seed, "chain": settings.chain, "situations": situations}]
    models, path = tools_of(settings.source)[0].models["learned"], settings.source.folder() / CALIBRATION
    _learn(examples, models, path, {"command": command, "chains": chains})


def _learn(
    examples: Sequence[StepExample],
    models: Models,
    path: Path,
    training: Mapping[str, Any],
    finish: Callable[[Calibration], Calibration] = lambda fitted: fitted,
) -> None:
    """Learn a calibration, `finish` it, and write it with its `training`; tell its errors."""
    calibration = finish(fit_calibration(examples, models))
    checked = cross_validated(examples, models, finish)
    save_calibration(path, calibration, {**training, "cross_validation": checked})
    _report(checked)
    print(f"wrote {path}: {', '.join(calibration.shortfalls)}")


def joined(kept: Calibration, learned: Calibration, actions: Sequence[str] | None) -> Calibration:
    """Return what was learned; where `actions` are given, of these only, and what is `kept` of the others.

    Raises
    ------
    EvaluationError
        One of them has too few examples.
    """
    if actions is None:
        return learned
    for name in actions:
        if name not in learned.shortfalls:
            raise EvaluationError(f"--actions: {name}: expected chains of more situations, got too few")
    return Calibration({**kept.shortfalls, **{name: learned.shortfalls[name] for name in actions}})


def _check(file: Path, result: Mapping[str, Any], source: ToolsetSource) -> None:
    """Make sure that an evaluation used our robot and models: corrections hold for these only."""
    ours, found = source.digests(result["settings"]["chain"]), result.get("digests")
    if not isinstance(found, dict):
        raise EvaluationError(f"{file}: expected the digests of robot and models, got none: evaluate again")
    others = [name for name, digest in ours.items() if found.get(name) != digest]
    if others:
        raise EvaluationError(
            f"{file}: expected chains executed with the robot and the models of {source.folder()}, "
            f"got another {', another '.join(others)}: evaluate again"
        )


def _report(checked: dict[str, dict[str, Any]]) -> None:
    print(f"{'predicted - actual, s':24}{'chains':>8}{'raw':>9}{'corrected':>11}{'95 %':>18}{'MAE':>15}")
    for name, row in checked.items():
        low, high = row["corrected_ci95"]
        print(
            f"{name:24}{row['chains']:8}{row['raw_s']:+9.3f}{row['corrected_s']:+11.3f}"
            f"{f'{low:+.3f} to {high:+.3f}':>18}{row['raw_mae_s']:8.3f}{row['corrected_mae_s']:7.3f}"
        )
