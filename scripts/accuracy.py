"""Write a page with the accuracy of learned models, or with the feature ablation.

Both are as in the paper, at the end of section 3.

scripts/run python scripts/accuracy.py --models models --out models/accuracy.md
scripts/run python scripts/accuracy.py experience.parquet fresh.parquet --out ablation.md
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from ator_ros.bases.description import Robot
from ator_ros.domains.domain import GROUP, Domain, entry_points_of, find_domain
from ator_ros.experience.table import read_experience
from ator_ros.files import portable_command, write_text
from ator_ros.performance.accuracy import accuracy
from ator_ros.performance.features import PAPER_3, PAPER_11, SIGNED, Feature
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.model_file import load_model
from ator_ros.performance.training import train
from ator_ros.world.state import AT_REST

PAPER_ERRORS: Mapping[str, str] = {"goToPose": "0.31 / 0.75", "dribbleBall": "0.29 / 0.73"}
"""Mean absolute and root-mean-square error in s in the paper, by action."""
Features = tuple[Feature, ...]
ABLATION: dict[str, Features] = {
    "the paper's 3": PAPER_3,
    "the paper's 11": PAPER_11,
    "3, signed angles and velocities": (*PAPER_3, *SIGNED),
}
"""First rows of the ablation: candidate features."""


def accuracy_table(
    models: Iterable[PerformanceModel], published: Mapping[str, str]
) -> Iterator[str]:
    """Yield lines of Markdown: the accuracy in the model files, and the paper's errors."""
    yield "| action | set | kind of start | episodes | MAE (s) | RMSE (s) | relative | paper |"
    yield "| --- | --- | --- | --- | --- | --- | --- | --- |"
    for model in models:
        measured = model.metadata["accuracy"]
        paper = published.get(model.action, "-")
        for kind, numbers in {"at rest": measured, **measured.get("kinds", {})}.items():
            if numbers:
                which = f"{model.action} | {model.metadata['action_set']} | {kind}"
                yield f"| {which} | {_numbers(numbers)} | {paper} |"
            paper = ""


def success_table(models: Iterable[PerformanceModel]) -> Iterator[str]:
    """Yield lines of Markdown: the accuracy of predicted success."""
    yield "| action | set | succeeded | Brier score | of the base rate | gain, 95 % interval |"
    yield "| --- | --- | --- | --- | --- | --- |"
    for model in models:
        success = model.metadata["accuracy"].get("success")
        if success:
            low, high = success["brier_gain_ci95"]
            which = f"{model.action} | {model.metadata['action_set']}"
            scores = f"{success['brier']:.4f} | {success['brier_base_rate']:.4f}"
            rate = f"{100 * success['success_rate']:.2f} %"
            yield f"| {which} | {rate} | {scores} | {low:+.4f} to {high:+.4f} |"


def ablation_table(
    experience: Mapping[str, pd.DataFrame],
    fresh: Mapping[str, pd.DataFrame],
    robot: Robot,
    domain: Domain,
    *,
    seed: int,
) -> Iterator[str]:
    """Yield lines of Markdown: accuracy for starts at rest with several sets of candidate features.

    Parameters
    ----------
    experience, fresh : mapping of str to pandas.DataFrame
        Rows to learn from, and rows of fresh episodes, by action.
    robot : Robot
        The robot of both.
    domain : Domain
        The domain, whose candidates are the last row.
    seed : int
        Seed of the fresh episodes.
    """
    yield "| action | candidates | leaves | features used | MAE (s) | RMSE (s) |"
    yield "| --- | --- | --- | --- | --- | --- |"
    for action, rows in experience.items():
        if action not in fresh:
            continue
        starts = fresh[action]
        starts = starts[(starts["t"] == 0.0) & (starts["v"].abs() <= AT_REST.speed)]
        chosen = domain.candidates(action)
        for label, features in {**ABLATION, "shipped": chosen}.items():
            model = train(action, rows, robot, features=features)
            result = accuracy(model, starts, seed=seed)
            used = model.used_features
            leaves = model.trees["duration"].n_leaves
            yield (
                f"| {action} | {label} | {leaves} | {len(used)}: {', '.join(used)} | "
                f"{_interval(result, 'mae_s')} | {_interval(result, 'rmse_s')} |"
            )


def _interval(numbers: Mapping[str, Any], name: str) -> str:
    low, high = numbers[f"{name}_ci95"]
    return f"{numbers[name]:.3f} ({low:.3f} to {high:.3f})"


def _numbers(numbers: Mapping[str, Any]) -> str:
    return (
        f"{numbers['episodes']} | {_interval(numbers, 'mae_s')} | {_interval(numbers, 'rmse_s')} | "
        f"{100 * numbers['relative_error']:.1f} %"
    )


def shipped(folder: Path, domain: Domain, robot: Robot) -> list[PerformanceModel]:
    """Return the models of a domain in a folder whose accuracy was measured."""
    # their models are in folders with their names
    others = set(entry_points_of(GROUP)) - {domain.name}
    models = []
    for path in sorted(folder.rglob("*.json")):
        if path.relative_to(folder).parts[0] in others:
            continue
        model = load_model(path, robot, domain.known_features)
        if model.metadata["accuracy"]:
            models.append(model)
    return models


def main(argv: Sequence[str] | None = None) -> int:
    """Write one of the pages."""
    words = list(sys.argv[1:] if argv is None else argv)
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "tables", nargs="*", type=Path, metavar="FILE", help="experience and fresh episodes"
    )
    parser.add_argument(
        "--models", type=Path, metavar="DIR", help="folder of the models (default: as shipped)"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.md")
    options = parser.parse_args(words)
    domain = find_domain()
    robot = domain.robot()
    if options.tables:
        experience, fresh = map(read_experience, options.tables)
        rows = dict(iter(experience.frame.groupby("action", sort=False)))
        others = dict(iter(fresh.frame.groupby("action", sort=False)))
        title = "Feature ablation"
        seed = fresh.metadata.get("seed") or 0
        lines = list(ablation_table(rows, others, robot, domain, seed=seed))
    else:
        models = shipped(domain.models_root(options.models), domain, robot)
        title = "Accuracy of the performance models"
        lines = [
            *accuracy_table(models, PAPER_ERRORS),
            "",
            "## Success",
            "",
            *success_table(models),
        ]
    command = portable_command("accuracy.py", words)
    text = "\n".join(lines)
    made = f"Made by `{command}`.\n\nTimes in s, with 95 % bootstrap intervals."
    write_text(options.out, f"# {title}\n\n{made}\n\n{text}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
