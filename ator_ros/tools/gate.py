"""Learn when refinement pays, from situations of their own (paper, section 5)."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from ator_ros.domains.domain import Domain, find_domain
from ator_ros.evaluation.gate_from_episodes import gate_of_episodes
from ator_ros.evaluation.gate_learning import (
    LearnedGate,
    LearnedGates,
    fit_threshold,
    fit_to_drawn_errors,
    gate_examples,
    learn_gates,
)
from ator_ros.evaluation.policies import UNGATED
from ator_ros.evaluation.running import run_situations
from ator_ros.evaluation.situation import Settings
from ator_ros.evaluation.toolset import ToolsetSource, make_library
from ator_ros.evaluation.trials import EvaluationError
from ator_ros.experience.parallel import EVERY_CORE, Workers
from ator_ros.experience.table import join, read_experience
from ator_ros.refinement.gate import GATE, save_gate
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


def learn_gate(
    source: ToolsetSource,
    chain: str,
    work: Path,
    *,
    command: str,
    situations: int = 400,
    seed: int = 301,
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
    draw_errors : bool
        Learn a threshold from errors drawn for each chain from those of similar ones.
    """
    source.require_executable(chain)
    settings = Settings(seed, chain, ("naive", *UNGATED), source=source)
    records = run_situations(settings, situations=situations, folder=work, workers=workers)
    learned = learn_gates(gate_examples(records), fit_to_drawn_errors if draw_errors else fit_threshold)
    better = learned.threshold if draw_errors else learned.better
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
    if not options.episodes:
        learn_gate(
            source, chain, options.work, command=command, **sizes, draw_errors=options.draw_errors,
            workers=workers_of(options),
        )  # fmt: skip
    elif options.draw_errors:
        raise EvaluationError("--draw-errors: expected without --episodes, as it takes executed chains")
    else:
        learn_gate_from_episodes(source, chain, options.episodes, command=command, **sizes)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    return run_tool(arguments(), _run, argv, interrupted=RESUMES, chain=lambda domain: domain.chains)
