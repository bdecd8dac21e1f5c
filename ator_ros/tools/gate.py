"""Learn when refinement pays, from situations of their own (paper, section 5)."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from ator_ros.domains.domain import Domain
from ator_ros.evaluation.gate_learning import fit_gate, gate_examples
from ator_ros.evaluation.policies import UNGATED
from ator_ros.evaluation.running import run_situations
from ator_ros.evaluation.situation import Settings
from ator_ros.evaluation.toolset import ToolsetSource
from ator_ros.refinement.gate import GATE, save_gate
from ator_ros.tools.command_line import (
    RESUMES,
    add_models,
    add_parallel_options,
    add_setting,
    run_tool,
    source_of,
    whole,
)


def learn_gate(
    source: ToolsetSource,
    chain: str,
    work: Path,
    *,
    command: str,
    situations: int = 400,
    seed: int = 301,
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
    situations, seed
        As for `run_situations`.
    """
    source.require_executable(chain)
    settings = Settings(seed, chain, ("naive", *UNGATED), source=source)
    gate = fit_gate(gate_examples(run_situations(settings, situations=situations, folder=work)))
    path = source.folder() / GATE
    save_gate(path, gate, {"command": command, "seed": seed, "situations": situations}, source.action_set)
    print(f"wrote {path}: {gate}")


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `gate`."""
    parser = argparse.ArgumentParser(prog="gate", description=__doc__)
    parser.add_argument("--situations", type=whole(10), default=400, metavar="N", help="default: %(default)s")
    parser.add_argument("--seed", type=whole(), default=301, help="of the situations (default: %(default)s)")
    add_setting(parser)
    parser.add_argument("--chain", metavar="NAME", help="of the domain (default: its first)")
    add_models(parser)
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
    learn_gate(
        source_of(options), options.chain, options.work, command=command, situations=options.situations,
        seed=options.seed,
    )  # fmt: skip


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    return run_tool(arguments(), _run, argv, interrupted=RESUMES, chain=lambda domain: domain.chains)
