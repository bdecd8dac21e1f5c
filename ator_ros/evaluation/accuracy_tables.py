"""Accuracy and feature ablation as tables for the docs (paper, end of section 3)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import pandas as pd

from ator_ros.domains.domain import Domain
from ator_ros.performance.accuracy import accuracy
from ator_ros.performance.features import IDEAL, PAPER_3, PAPER_11, SIGNED, Feature
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.training import Training, train
from ator_ros.robot.description import Robot
from ator_ros.world.state import AT_REST

Features = tuple[Feature, ...]
_Row = tuple[Features, Training]
ABLATION: dict[str, _Row] = {
    "the paper's 3, all 10 Hz examples": (PAPER_3, Training(later_weight=1.0)),
    "the paper's 3, starts": (PAPER_3, Training()),
    "the paper's 11, all 10 Hz examples": (PAPER_11, Training(later_weight=1.0)),
    "the paper's 11, starts": (PAPER_11, Training()),
    "3, signed angles and velocities, starts": ((*PAPER_3, *SIGNED), Training()),
}
"""First rows of the ablation: candidate features, and weights of starts and later examples."""


def accuracy_table(models: Iterable[PerformanceModel], published: Mapping[str, str]) -> Iterator[str]:
    """Yield lines of Markdown: what the model files say about themselves.

    Parameters
    ----------
    models : iterable of PerformanceModel
        Measured models.
    published : mapping
        Mean absolute and root-mean-square error in s that the paper reports, by action.
    """
    yield "| action | set | kind of start | episodes | MAE (s) | RMSE (s) | relative | paper |"
    yield "| --- | --- | --- | --- | --- | --- | --- | --- |"
    for model in models:
        measured = model.metadata["accuracy"]
        paper = published.get(model.action, "-")
        for kind, numbers in {"at rest": measured, **measured.get("kinds", {})}.items():
            if numbers:
                which = f"{model.action} | {_set(model)} | {kind}"
                yield f"| {which} | {_numbers(numbers)} | {paper} |"
            paper = ""


def _set(model: PerformanceModel) -> str:
    """Return the action set of a model, and whether it knows nothing but what was observed."""
    observed = ", observed" if model.driving is not None else ""
    return f"{model.metadata['action_set']}{observed}"


def success_table(models: Iterable[PerformanceModel]) -> Iterator[str]:
    """Yield lines of Markdown: how well success is predicted."""
    yield "| action | set | succeeded | Brier score | of the base rate | gain, 95 % interval |"
    yield "| --- | --- | --- | --- | --- | --- |"
    for model in models:
        success = model.metadata["accuracy"].get("success")
        if success:
            low, high = success["brier_gain_ci95"]
            which = f"{model.action} | {_set(model)}"
            yield (
                f"| {which} | {100 * success['success_rate']:.2f} % | "
                f"{success['brier']:.4f} | {success['brier_base_rate']:.4f} | {low:+.4f} to {high:+.4f} |"
            )


def ablation_table(
    experience: Mapping[str, pd.DataFrame],
    fresh: Mapping[str, pd.DataFrame],
    robot: Robot,
    domain: Domain,
    *,
    seed: int,
    suited: Callable[[Features], Features] = lambda features: features,
) -> Iterator[str]:
    """Yield lines of Markdown: accuracy at starts at rest for several sets of candidate features.

    Parameters
    ----------
    experience, fresh : mapping
        Rows to learn from and rows of fresh episodes, by action.
    robot : Robot
        The robot of both.
    domain : Domain
        Whose actions choose features.
    seed : int
        Of the fresh episodes.
    suited : callable
        Returns features with what is chosen for the robot; by default as they are.
    """
    yield "| action | candidates | leaves | features used | MAE (s) | RMSE (s) |"
    yield "| --- | --- | --- | --- | --- | --- |"
    for action, rows in experience.items():
        if action not in fresh:
            continue
        starts = fresh[action]
        starts = starts[(starts["t"] == 0.0) & (starts["v"].abs() <= AT_REST.v)]
        for label, (features, how) in _rows(domain, action).items():
            model = train(action, rows, robot, features=suited(features), training=how)
            result = accuracy(model, starts, seed=seed)
            used, leaves = model.used_features, model.trees["duration"].n_leaves
            yield (
                f"| {action} | {label} | {leaves} | {len(used)}: {', '.join(used)} | "
                f"{_interval(result, 'mae_s')} | {_interval(result, 'rmse_s')} |"
            )


def _rows(domain: Domain, action: str) -> dict[str, _Row]:
    ideal = [feature for feature in domain.features if _is_ideal(feature) and feature.translation]
    everything = (*PAPER_11, *SIGNED, *IDEAL, *ideal)
    chosen = domain.candidates(action)
    observed = tuple(feature for feature in chosen if not _is_ideal(feature))
    return {
        **ABLATION,
        "all, all 10 Hz examples": (everything, Training(later_weight=1.0)),
        "all, starts": (everything, Training()),
        "chosen, without ideal times, starts": (observed, Training()),
        "chosen, starts (shipped)": (chosen, Training()),
    }


def _is_ideal(feature: Feature) -> bool:
    """Return whether a feature describes the action's ideal motion."""
    return feature.ideal or feature.described


def _interval(numbers: Mapping[str, Any], name: str) -> str:
    low, high = numbers[f"{name}_ci95"]
    return f"{numbers[name]:.3f} ({low:.3f} to {high:.3f})"


def _numbers(numbers: Mapping[str, Any]) -> str:
    return (
        f"{numbers['episodes']} | {_interval(numbers, 'mae_s')} | {_interval(numbers, 'rmse_s')} | "
        f"{100 * numbers['relative_error']:.1f} %"
    )
