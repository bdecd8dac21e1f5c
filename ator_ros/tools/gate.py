"""Learn the gate, and refit the rulers' time models, from situations of their own (paper, section 5)."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ator_ros.domains.domain import Domain, find_domain
from ator_ros.evaluation.gate_learning import compare_gates, fit_threshold, fit_tree, gate_examples
from ator_ros.evaluation.heuristics import save_baselines
from ator_ros.evaluation.running import RESUMES
from ator_ros.evaluation.situation import Settings
from ator_ros.evaluation.toolset import BASELINES, GATE, ToolsetSource, read_rows
from ator_ros.files import portable_command, reserved
from ator_ros.refinement.gate_file import save_gate
from ator_ros.tools.command_line import add_domain, add_parallel_options, domain_in, executed, guarded, whole

_GATE_BYTES = 100_000
POLICIES = ("naive", "refined", "refined_speed")


def arguments(domain: Domain) -> argparse.ArgumentParser:
    """Return the command line of `gate`."""
    parser = argparse.ArgumentParser(prog="gate", description=__doc__)
    parser.add_argument("--situations", type=whole(10), default=400, metavar="N", help="default: %(default)s")
    parser.add_argument("--seed", type=whole(), default=301, help="of the situations (default: %(default)s)")
    add_domain(parser)
    parser.add_argument("--action-set", choices=list(domain.action_sets), default="default")
    parser.add_argument(
        "--models", default="", metavar="DIR", help="folder of the models (default: as shipped)"
    )
    parser.add_argument(
        "--experience",
        nargs="+",
        metavar="FILE",
        help="tables: refit the rulers' models to them",
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


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; give the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    options = arguments(domain_in("gate", words)).parse_args(words)
    command = portable_command("gate", words)
    return guarded("gate", lambda: _learn(options, command), interrupted=RESUMES)


def _learn(options: argparse.Namespace, command: str) -> int:
    source = ToolsetSource(domain=options.domain, action_set=options.action_set, models=options.models)
    if options.experience is not None:
        refit_rulers(source, options.experience)
    settings = Settings(seed=options.seed, policies=POLICIES, source=source)
    with reserved(source.folder(), _GATE_BYTES):
        records = executed(settings, options, options.work)
    examples = gate_examples(records)
    comparison = compare_gates(examples)
    tree, threshold = fit_tree(examples), fit_threshold(examples)
    best = tree if comparison["tree"]["utility"] > comparison["threshold"]["utility"] else threshold
    training: dict[str, Any] = {
        "command": command,
        "seed": options.seed,
        "situations": len(records),
        "cross_validation": comparison,
        "tree_rules": tree.rules(),
        "threshold": {"gain": threshold.gain, "spread_factor": threshold.spread_factor},
    }
    save_gate(source.folder() / GATE, best, training, options.action_set)
    _report(training, best.kind, source.folder() / GATE)
    return 0


def refit_rulers(source: ToolsetSource, experience: Sequence[str]) -> None:
    """Refit the rulers' time models to the starts of successful episodes, and write them to the models."""
    tables = read_rows(experience)
    starts = {action: rows[(rows["t"] == 0.0) & rows["success"]] for action, rows in tables.items()}
    domain = find_domain(source.domain)
    save_baselines(source.folder() / BASELINES, starts, domain.robot(), domain.tops)


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
    print(f"wrote {path}: {shipped}")


if __name__ == "__main__":
    sys.exit(main())
