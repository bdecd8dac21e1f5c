"""Learn the gate, and refit the rulers' time models, from situations of their own (paper, section 5)."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ator_ros.domains.domain import find_domain
from ator_ros.evaluation.calibration_learning import StepExample, step_examples
from ator_ros.evaluation.corrected_gains import with_corrected_gains
from ator_ros.evaluation.drawn_errors import fit_to_drawn_errors
from ator_ros.evaluation.errors import EvaluationError
from ator_ros.evaluation.gate_from_episodes import gate_of_episodes
from ator_ros.evaluation.gate_learning import (
    GateExamples,
    LearnedGate,
    LearnedGates,
    gate_examples,
    learn_gates,
)
from ator_ros.evaluation.heuristics import save_baselines
from ator_ros.evaluation.running import results_in
from ator_ros.evaluation.situation import Record, Settings
from ator_ros.evaluation.toolset import BASELINES, ToolsetSource, make_library, read_rows, tools_of
from ator_ros.files import reserved, write_text
from ator_ros.refinement.gate import GATE, Gate, OpenGate, gate_in, opened, save_gate
from ator_ros.tools.command_line import source_of
from ator_ros.tools.work.calibrate_predictions import save_learned
from ator_ros.tools.work.situations import executed

_GATE_BYTES = 100_000
POLICIES = ("naive", "refined", "refined_speed")
ROOM = 1.5
"""Multiple of the way to stop that `--room` keeps free ahead of an arrival."""


def run(options: argparse.Namespace, command: str) -> int:
    """Do what the command line asks for; return the exit code."""
    source = source_of(options)
    executed_only = [name for name in ("room", "calibrate", "draw_errors") if getattr(options, name)]
    if options.episodes and executed_only:
        option = executed_only[0].replace("_", "-")
        raise EvaluationError(f"--{option}: expected without --episodes, as it takes executed chains")
    if options.episodes:
        return _learn_from_episodes(source, options, command)
    if options.experience is not None:
        refit_rulers(source, options.experience)
    settings = Settings(seed=options.seed, chain=options.chain, policies=POLICIES, source=source)
    source.require_executable(options.chain)
    source.digests(options.chain)  # before anything is executed: a missing model is reported at once
    if options.room:
        settings = _with_room(settings, options.work / "models", options.action_set)
    gate = tools_of(settings.source)[0].gate
    with reserved(source.folder(), _GATE_BYTES), results_in(options.work, options.situations):
        records = executed(settings, options, options.work)
    settings = dataclasses.replace(settings, source=source)
    steps: list[StepExample] = []
    if options.calibrate:
        steps, records = _corrected(records, settings, gate)
        gate = dataclasses.replace(opened(gate), corrected=bool(steps))
    learned, better = _learned(gate_examples(records), options)
    better = dataclasses.replace(better, widths=gate.widths, room=gate.room, corrected=gate.corrected)
    if steps:
        save_learned(steps, settings, situations=len(records), command=command)
    _save(better, learned, source.folder() / GATE, options, command)
    return 0


def _corrected(
    records: list[Record], settings: Settings, gate: Gate
) -> tuple[list[StepExample], list[Record]]:
    """Return the actions that teach a correction, if they do, and the records as a gate sees them with it."""
    tools, library = tools_of(settings.source)
    tools = dataclasses.replace(tools, gate=dataclasses.replace(opened(gate), corrected=True))
    seed, chain = settings.seed, settings.chain
    try:
        steps = step_examples(records, seed=seed, chain=chain, tools=tools, library=library)
        return steps, with_corrected_gains(
            records, steps, seed=seed, chain=chain, tools=tools, library=library
        )
    except EvaluationError as error:
        print(f"without a calibration: {error}")
        return [], records


def _learned(examples: GateExamples, options: argparse.Namespace) -> tuple[LearnedGates, LearnedGate]:
    """Return the gates that the examples teach, and the one to use; a threshold where errors are drawn."""
    if not options.draw_errors:
        learned = learn_gates(examples)
        return learned, learned.better
    learned = learn_gates(examples, fit_to_drawn_errors)
    return learned, learned.threshold


def _with_room(settings: Settings, folder: Path, action_set: str) -> Settings:
    """Return the settings with a copy of the models in `folder`, beside a gate that asks for room to stop."""
    source, copied = settings.source, dataclasses.replace(settings.source, models=str(folder))
    for file in source.folder().glob("*.json"):
        if file.name != GATE:
            write_text(copied.folder() / file.name, file.read_text(encoding="utf-8"))
    save_gate(
        copied.folder() / GATE,
        OpenGate(widths=gate_in(source.folder(), action_set).widths, room=ROOM),
        {},
        action_set,
    )
    return dataclasses.replace(settings, source=copied)


def _learn_from_episodes(source: ToolsetSource, options: argparse.Namespace, command: str) -> int:
    """Learn the gate of the observed models, with those of the chain's actions that the tables hold."""
    gate, learned = gate_of_episodes(
        find_domain(source.domain),
        make_library(source.described(), source),
        read_rows(options.episodes),
        options.chain,
        seed=options.seed,
        situations=options.situations,
    )
    _save(gate, learned, source.observed_folder() / GATE, options, command)
    return 0


def _save(
    gate: LearnedGate, learned: LearnedGates, path: Path, options: argparse.Namespace, command: str
) -> None:
    training: dict[str, Any] = {
        "command": command,
        "seed": options.seed,
        "situations": options.situations,
        "cross_validation": learned.comparison,
        "tree_rules": learned.tree.rules(),
        "threshold": {"gain": learned.threshold.gain, "spread_factor": learned.threshold.spread_factor},
    }
    save_gate(path, gate, training, options.action_set)
    _report(training, gate.kind, path)


def refit_rulers(source: ToolsetSource, experience: Sequence[str]) -> None:
    """Refit the rulers' time models to the starts of successful episodes, and write them to the models."""
    tables = read_rows(experience)
    starts = {action: rows[(rows["t"] == 0.0) & rows["success"]] for action, rows in tables.items()}
    tops = find_domain(source.domain).tops
    save_baselines(source.folder() / BASELINES, starts, source.described(), tops)


def _report(training: dict[str, Any], shipped: str, path: Path) -> None:
    names = ("mean_gain_s", "kept_gain_percent", "higher", "equal", "lower", "refined_percent", "utility")
    print(f"{'cross-validated':16}" + "".join(f"{name:>19}" for name in names))
    for kind, row in training["cross_validation"].items():
        print(f"{kind:16}" + "".join(f"{row[name]:>19}" for name in names))
    print(
        f"the tree labels {training['cross_validation']['tree']['accuracy_percent']} % correctly; its rules:"
    )
    for rule in training["tree_rules"]:
        print(f"  {rule}")
    print(f"threshold: {training['threshold']}")
    never = "" if training["cross_validation"][shipped]["refined_percent"] else ", which refines nothing here"
    print(f"chosen: the {shipped}{never}; wrote {path}")
