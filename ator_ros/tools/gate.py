"""Learn when refinement pays, from situations of their own (paper, section 5)."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ator_ros.domains.domain import Domain
from ator_ros.evaluation.running import run_situations
from ator_ros.evaluation.situation import Settings
from ator_ros.evaluation.statistics import labels
from ator_ros.evaluation.trials import EvaluationError
from ator_ros.geometry import FloatArray
from ator_ros.refinement.gate import GATE, Gate, save_gate
from ator_ros.tools.command_line import (
    RESUMES,
    add_models,
    add_parallel_options,
    add_setting,
    run_tool,
    source_of,
    whole,
)

UNGATED = ("refined", "refined_speed")
"""Policies without a gate, from whose runs a gate is learned."""
GAINS = (0.05, 0.08, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5)
"""Least predicted gains in s that are tried: less than a control tick shows in no execution."""
SPREAD_FACTORS = (0.0, 0.25, 0.5, 1.0)
KEPT = 0.97
"""Least share of the ungated gain that a gate keeps, with and without refined speeds."""


class GateExamples(NamedTuple):
    """Situations executed naive and refined.

    Attributes
    ----------
    gain, spread : ndarray, shape (n,)
        Predicted gain in s, and the spread of the two predictions in s.
    naive, refined : ndarray, shape (n,)
        Durations in s.
    kind : ndarray of int, shape (n,)
        0: the heading was refined; 1: heading and arrival speed.
    """

    gain: FloatArray
    spread: FloatArray
    naive: FloatArray
    refined: FloatArray
    kind: NDArray[np.int64]


def gate_examples(records: Iterable[Mapping[str, Any]]) -> GateExamples:
    """Return the examples in records of `evaluate_trial`, with and without refined arrival speed.

    Raises EvaluationError if none of the situations had a free variable.
    """
    rows = []
    for record in records:
        naive = record["policies"]["naive"]["duration"]
        for kind, policy in enumerate(UNGATED):
            run = record["policies"][policy]
            if "gain" in run:
                rows.append((run["gain"], run["spread"], naive, run["duration"], kind))
    if not rows:
        raise EvaluationError("expected situations with a free variable, got none")
    return GateExamples(*map(np.array, zip(*rows, strict=True)))


def fit_gate(examples: GateExamples) -> Gate:
    """Return the gate with the fewest slower runs among those that keep the share `KEPT` of the gain.

    If no gate keeps so much, it is one of those that keep most.
    """
    gates = [Gate(least, factor) for least in GAINS for factor in SPREAD_FACTORS]
    refine = [examples.gain > gate.needed(examples.spread) for gate in gates]
    kept = [_kept(examples, rows) for rows in refine]
    allowed = [index for index, share in enumerate(kept) if share >= min(KEPT, max(kept))]
    slower = labels(examples.refined, examples.naive) == "Lower"
    return gates[
        min(allowed, key=lambda index: (np.sum(slower & refine[index]), -_gain(examples, refine[index])))
    ]


def _gain(examples: GateExamples, rows: NDArray[np.bool_]) -> float:
    return float((examples.naive - examples.refined)[rows].sum())


def _kept(examples: GateExamples, refine: NDArray[np.bool_]) -> float:
    """Return the kept share of the ungated gain, of the kind of refinement that keeps least."""
    shares = []
    for kind in np.unique(examples.kind):
        of_kind = examples.kind == kind
        possible = _gain(examples, of_kind)
        shares.append(_gain(examples, refine & of_kind) / possible if possible > 0.0 else 1.0)
    return min(shares)


def _learn(options: argparse.Namespace, _: Domain, command: str) -> None:
    """Learn the gate of a chain from executed situations, and write it beside the models."""
    source = source_of(options)
    source.require_executable(options.chain)
    settings = Settings(options.seed, options.chain, ("naive", *UNGATED), source=source)
    records = run_situations(settings, situations=options.situations, folder=options.work)
    gate = fit_gate(gate_examples(records))
    path = source.folder() / GATE
    training = {"command": command, "seed": options.seed, "situations": options.situations}
    save_gate(path, gate, training, options.action_set)
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


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    return run_tool(arguments(), _learn, argv, interrupted=RESUMES, chain=lambda domain: domain.chains)
