"""Learn when refinement pays, from situations of their own (paper, section 5)."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from ator_ros.domains.domain import Domain, find_domain
from ator_ros.evaluation.calibration_learning import StepExample, step_examples
from ator_ros.evaluation.gate_from_episodes import gate_of_episodes
from ator_ros.evaluation.gate_learning import (
    LearnedGate,
    LearnedGates,
    fit_threshold,
    fit_to_drawn_errors,
    gate_examples,
    learn_gates,
    with_corrected_gains,
)
from ator_ros.evaluation.policies import UNGATED
from ator_ros.evaluation.running import run_situations
from ator_ros.evaluation.situation import Record, Settings
from ator_ros.evaluation.toolset import ToolsetSource, make_library, tools_of
from ator_ros.evaluation.trials import EvaluationError
from ator_ros.experience.parallel import EVERY_CORE, Workers
from ator_ros.experience.table import join, read_experience
from ator_ros.refinement.gate import GATE, Gate, OpenGate, opened, save_gate
from ator_ros.tools.calibrate_predictions import save_learned
from ator_ros.tools.command_line import (
    RESUMES,
    add_models,
    add_parallel_options,
    add_setting,
    run_tool,
    source_of,
    whole,
    workers_of,
)

ROOM = 1.5
"""Multiple of the stopping distance that `room` keeps free ahead of an arrival."""


def learn_gate(
    source: ToolsetSource,
    chain: str,
    work: Path,
    *,
    command: str,
    situations: int = 400,
    seed: int = 301,
    room: bool = False,
    calibrate: bool = False,
    draw_errors: bool = False,
    workers: Workers = EVERY_CORE,
) -> None:
    """Learn the gate of a chain from executed situations, and write it beside the models.

    Parameters
    ----------
    source, chain
        Robot, actions and models, and the name of the domain's chain.
    work : Path
        Folder of partial results.
    command : str
        The command line, for the file.
    situations, seed, workers
        As for `run_situations`.
    room : bool
        Choose no arrival at a speed at which the robot could not stop before a bay.
    calibrate : bool
        Also learn corrections of predictions; the gate then judges corrected predictions.
    draw_errors : bool
        Learn a threshold from errors drawn for each chain from those of similar ones.
    """
    source.require_executable(chain)
    source.digests(chain)  # a missing model is reported before anything is executed
    gate, policies = tools_of(source)[0].gate, ("naive", *UNGATED)
    if room:
        gate = OpenGate(widths=gate.widths, room=ROOM)
    settings = Settings(seed, chain, policies, source=source, room=ROOM if room else 0.0)
    records = run_situations(settings, situations=situations, folder=work, workers=workers)
    steps: list[StepExample] = []
    if calibrate:
        steps, records = _corrected(records, source, seed, chain, gate)
        gate = dataclasses.replace(opened(gate), corrected=bool(steps))
    learned = learn_gates(gate_examples(records), fit_to_drawn_errors if draw_errors else fit_threshold)
    better = learned.threshold if draw_errors else learned.better
    better = dataclasses.replace(better, widths=gate.widths, room=gate.room, corrected=gate.corrected)
    if steps:
        chains = [{"seed": seed, "chain": chain, "situations": len(records)}]
        save_learned(steps, source, {"command": command, "chains": chains})
    _save(better, learned, source, command=command, seed=seed, situations=situations)


def learn_gate_from_episodes(
    source: ToolsetSource, chain: str, tables: Sequence[str], *, command: str, situations: int, seed: int
) -> None:
    """Learn the gate of observed models from their own experience; nothing is executed."""
    domain, library = find_domain(source.domain), make_library(source.described(), source)
    rows = join(read_experience(table).frame for table in tables)
    by_action = {str(action): part for action, part in rows.groupby("action", sort=False)}
    gate, learned = gate_of_episodes(domain, library, by_action, chain, seed=seed, situations=situations)
    _save(gate, learned, source, command=command, seed=seed, situations=situations)


def _corrected(
    records: list[Record], source: ToolsetSource, seed: int, chain: str, gate: Gate
) -> tuple[list[StepExample], list[Record]]:
    """Return examples for a calibration, if there are enough, and the records with corrected predictions."""
    tools, library = tools_of(source)
    tools = dataclasses.replace(tools, gate=dataclasses.replace(opened(gate), corrected=True))
    steps = step_examples(records, seed=seed, chain=chain, tools=tools, library=library)
    try:
        return steps, with_corrected_gains(
            records, steps, seed=seed, chain=chain, tools=tools, library=library
        )
    except EvaluationError as error:
        print(f"without a calibration: {error}")
        return [], records


def _save(
    gate: LearnedGate,
    learned: LearnedGates,
    source: ToolsetSource,
    *,
    command: str,
    seed: int,
    situations: int,
) -> None:
    """Write a gate beside the models, and report how it was chosen."""
    training = learned.training(command=command, seed=seed, situations=situations)
    path = source.folder() / GATE
    save_gate(path, gate, training, source.action_set)
    print(pd.DataFrame(learned.comparison).T.to_string())
    print("rules of the tree:", *training["tree_rules"], sep="\n  ")
    print(f"threshold: {training['threshold']}")
    never = "" if learned.comparison[gate.kind]["refined_percent"] else ", which refines nothing here"
    print(f"chosen: the {gate.kind}{never}; wrote {path}")


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `gate`."""
    parser = argparse.ArgumentParser(prog="gate", description=__doc__)
    parser.add_argument("--situations", type=whole(10), default=400, metavar="N", help="default: %(default)s")
    parser.add_argument("--seed", type=whole(), default=301, help="of the situations (default: %(default)s)")
    add_setting(parser)
    parser.add_argument("--chain", metavar="NAME", help="of the domain (default: its first)")
    add_models(parser)
    parser.add_argument(
        "--episodes",
        nargs="+",
        metavar="FILE",
        help="learn the gate of observed models from the tables that they learned from; execute nothing",
    )
    parser.add_argument(
        "--draw-errors",
        action="store_true",
        help="learn a threshold from errors drawn from those of chains that gain about as much: "
        "of some hundred chains only a handful become slower",
    )
    parser.add_argument(
        "--room",
        action="store_true",
        help="choose no arrival at a speed at which the robot could not stop before a bay",
    )
    parser.add_argument(
        "--calibrate",
        action="store_true",
        help="also learn from the same chains what predictions miss, as calibrate_predictions does; "
        "the gate then judges corrected predictions",
    )
    parser.add_argument(
        "--work",
        type=Path,
        default=Path("gate"),
        metavar="DIR",
        help="for partial results (default: %(default)s)",
    )
    add_parallel_options(parser)
    return parser


def _run(options: argparse.Namespace, _: Domain, command: str) -> None:
    source, chain = source_of(options), options.chain
    sizes = {"situations": options.situations, "seed": options.seed}
    of_executed = {name: getattr(options, name) for name in ("room", "calibrate", "draw_errors")}
    if not options.episodes:
        learn_gate(
            source, chain, options.work, command=command, **sizes, **of_executed, workers=workers_of(options)
        )
        return
    for name, given in of_executed.items():
        if given:
            option = name.replace("_", "-")
            raise EvaluationError(f"--{option}: expected without --episodes, as it takes executed chains")
    learn_gate_from_episodes(source, chain, options.episodes, command=command, **sizes)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    return run_tool(arguments(), _run, argv, interrupted=RESUMES, chain=lambda domain: domain.chains)
