"""Select the tree that predicts a measure of an action best, if it is significantly better."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.learning.candidates import BACK, FEWEST_LEARNED, TrainingData, TreeCandidate, candidates
from ator_ros.performance.model import MEASURES
from ator_ros.performance.tree.nodes import IntArray, ModelTree

_DRAWS = 5000
_SEED = 0


@dataclass(frozen=True)
class Comparison:
    """Two models on the same records.

    Attributes
    ----------
    before, after : float
        Mean losses of the present model, and of the other.
    chance : float
        One-sided p-value: the probability that this or another candidate appears as much better by chance.
    """

    before: float
    after: float
    chance: float


def compare(before: FloatArray, after: FloatArray) -> list[Comparison]:
    """Compare the losses of a model with those of others on the same records.

    Under the null hypothesis the signs of the differences are exchangeable: this is a sign-flip permutation
    test. It assumes no distribution, so outliers decide nothing. All others are compared with the same signs,
    and the p-value is that of the greatest of their statistics (Westfall and Young 1993), so many similar
    candidates are corrected for like one.

    Parameters
    ----------
    before : ndarray, shape (n,)
        Losses of the present model, at least 0.
    after : ndarray, shape (n, k)
        Those of the others.
    """
    gain = before[:, None] - after
    gain = gain / np.maximum(np.sqrt(np.sum(gain * gain, axis=0)), 1e-12)
    signs = np.random.default_rng(_SEED).choice((-1.0, 1.0), (_DRAWS, len(gain)))
    greatest = np.max(signs @ gain, axis=1)
    beyond = np.sum(greatest[:, None] >= gain.sum(axis=0) - 1e-12, axis=0)
    chances = (1.0 + beyond) / (_DRAWS + 1.0)
    return [
        Comparison(float(np.mean(before)), float(np.mean(losses)), float(chance))
        for losses, chance in zip(after.T, chances, strict=True)
    ]


TESTED = (25, 100)
"""Numbers of newest records on which trees are compared: few show a changed robot soon, many a small gain."""
FEWEST_TESTED = 12
LEVEL = 0.05
"""Significance level over all candidates of one round, and once more over those that were in use before."""
_FOLDS = 3
_EARLIER = 300
_NO_LOSS = 1e-9
_AS_GOOD = 0.05
"""p-value above which one candidate counts as no better than another."""


@dataclass(frozen=True)
class RoundVerdict:
    """Result of a round of learning for one measure of an action.

    Attributes
    ----------
    episodes : int
        Number of records of the measure.
    tested : int
        Number of the newest of them, on which trees were compared and from which none of these was learned.
    reason : str
        Why the tree stays or is replaced, in a sentence.
    kind : str
        Name of the better candidate; empty if there is none.
    before, after, chance
        As in `Comparison`, for the best candidate; None if none was compared or there was no tree.
        Losses are absolute errors (s, m, rad), of success squared ones (Brier score).
    tree : ModelTree or None
        The better one.
    error : float or None
        Usual error of its predictions on the tested records, from which it was not learned.
    """

    episodes: int
    tested: int
    reason: str
    kind: str = ""
    before: float | None = None
    after: float | None = None
    chance: float | None = None
    tree: ModelTree | None = None
    error: float | None = None


def judge(
    data: TrainingData,
    names: Sequence[str],
    *,
    current: ModelTree | None,
    seen: int,
    former: Mapping[str, ModelTree],
) -> RoundVerdict:
    """Compare the tree of a measure with all candidates on the newest records, which are new to it.

    These are split into folds. Each fold is predicted by candidates learned from all other records. A
    candidate that is better is learned again from all records.

    Parameters
    ----------
    data : TrainingData
        The records.
    names : sequence of str
        Features to learn from.
    current : ModelTree or None
        The tree in use.
    seen : int
        Number from which on records are new to it.
    former : mapping
        Trees that were in use before, by the names of their sets; those shipped, too.
    """
    count = len(data.values)
    test = np.flatnonzero(data.numbers >= seen)[-max(TESTED) :][::-1]  # newest first
    if len(test) < FEWEST_TESTED:
        kind = "" if data.measure == "success" else " that succeeded"
        return RoundVerdict(
            count, len(test), f"too few new records: {len(test)}, expected {FEWEST_TESTED}{kind}"
        )
    known = {"the present model": current} if current is not None else {}
    tried = _predictions(data, list(candidates(data, names, known, former)), test)
    if not tried:
        rest = count - math.ceil(len(test) / _FOLDS)
        why = "what was learned predicts no numbers"
        if rest < FEWEST_LEARNED:
            why = f"too few records: {rest} without those that are predicted, expected {FEWEST_LEARNED}"
        return RoundVerdict(count, len(test), why)
    if data.measure == "success" and current is not None:
        tried = [item for item in tried if _predicts_failures(data, item[0], current, test)]
        if not tried:
            return RoundVerdict(count, len(test), "no better: all candidates predict earlier failures worse")
    before = data.losses(_baseline(data, current, test), test)
    sizes = sorted({min(size, len(test)) for size in TESTED})
    for size in sizes:
        level = LEVEL / len(sizes)
        verdict = _verdict(data, tried, before, test[:size], level=level, current=current is not None)
        if verdict.tree is not None:
            break
    return verdict


def _baseline(data: TrainingData, current: ModelTree | None, test: IntArray) -> FloatArray:
    """Return the predictions of the tree in use; without one, the best constant of the other records."""
    if current is not None:
        return data.predicted(current, test)
    others = np.setdiff1d(np.arange(len(data.values)), test)
    values = data.values[others if len(others) >= FEWEST_TESTED else slice(None)]
    middle = np.mean(values) if data.measure == "success" else np.median(values)
    return np.full(len(test), float(middle))


def _predictions(
    data: TrainingData, tried: Sequence[TreeCandidate], test: IntArray
) -> list[tuple[TreeCandidate, FloatArray]]:
    """Return the candidates that can be learned, and their predictions of the tested records."""
    everything = np.arange(len(data.values))
    predictions = []
    for candidate in tried:
        predicted = np.full(len(test), np.nan)
        folds = 1 if candidate.slow else _FOLDS
        for fold in range(folds):
            part = slice(fold, None, folds)
            tree = candidate.learn(np.setdiff1d(everything, test[part], assume_unique=True))
            if tree is not None:
                predicted[part] = data.predicted(tree, test[part])
        if np.isfinite(predicted).all():
            predictions.append((candidate, predicted))
    return predictions


def _predicts_failures(
    data: TrainingData, candidate: TreeCandidate, current: ModelTree, test: IntArray
) -> bool:
    """Return whether a candidate predicts earlier records, with their failures, as well as the tree in use.

    Chains predicted to fail are no longer executed, so on the newest records alone a tree that predicts no
    failures would appear better.
    """
    which = np.arange(len(data.values))[-_EARLIER:]
    tree = _retrained(data, candidate, test)
    before, after = (np.mean(data.losses(data.predicted(t, which), which)) for t in (current, tree))
    return bool(after <= before + _NO_LOSS)


def _verdict(
    data: TrainingData,
    tried: Sequence[tuple[TreeCandidate, FloatArray]],
    before: FloatArray,
    test: IntArray,
    *,
    level: float,
    current: bool,
) -> RoundVerdict:
    losses = [data.losses(predicted[: len(test)], test) for _, predicted in tried]
    names = [candidate.name for candidate, _ in tried]
    number, compared = _best(names, before[: len(test)], losses, level)
    best = compared[number]
    name, unit = names[number], MEASURES[data.measure]
    figures = f"{best.before:.3g} to {best.after:.3g}{unit and f' {unit}'} on {len(test)} records"
    counts = (len(data.values), len(test))
    loss = "Brier score" if data.measure == "success" else "error"
    loss_before = best.before if current else None
    if not _is_better(best, level):
        reason = f"no better: {name} would change the {loss} from {figures} (chance {best.chance:.3f})"
        return RoundVerdict(*counts, reason, "", loss_before, best.after, best.chance)
    tree = _retrained(data, tried[number][0], test)
    error = 1.4826 * float(np.median(losses[number]))  # standard deviation, robust against outliers
    return RoundVerdict(
        *counts, f"{name}: {loss} from {figures}", name, loss_before, best.after, best.chance, tree, error
    )


def _retrained(data: TrainingData, candidate: TreeCandidate, test: IntArray) -> ModelTree:
    which = np.arange(len(data.values))
    tree = candidate.learn(np.setdiff1d(which, test) if candidate.slow else which)
    assert tree is not None  # it was learned from fewer records
    return tree


def _best(
    names: Sequence[str], before: FloatArray, losses: Sequence[FloatArray], level: float
) -> tuple[int, list[Comparison]]:
    """Return the number of the best candidate, significant ones first, and all comparisons."""
    compared: list[Comparison] = [Comparison(0.0, 0.0, 1.0)] * len(names)
    for back in (False, True):
        group = [number for number, name in enumerate(names) if name.startswith(BACK) == back]
        if group:
            results = compare(before, np.column_stack([losses[number] for number in group]))
            for number, result in zip(group, results, strict=True):
                compared[number] = result
    better = [number for number, found in enumerate(compared) if _is_better(found, level)]
    least = min(better or range(len(names)), key=lambda number: compared[number].after)
    for number in better:
        # Of those that are about as good as the best, the first: it was learned from most records.
        if number == least or compare(losses[number], losses[least][:, None])[0].chance >= _AS_GOOD:
            return number, compared
    return least, compared


def _is_better(compared: Comparison, level: float) -> bool:
    return compared.after < compared.before and compared.chance < level
