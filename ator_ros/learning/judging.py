"""Which tree predicts a measure of an action best, and whether that is more than noise explains."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.learning.candidates import BACK, FEWEST_LEARNED, Lessons, TreeCandidate, candidates
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
        Mean losses of the model that is there, and of the other.
    chance : float
        Probability that the other, or any that was compared beside it, would seem as much better if none
        were: one-sided.
    """

    before: float
    after: float
    chance: float


def compare(before: FloatArray, after: FloatArray) -> list[Comparison]:
    """Compare the losses of a model with those of others on the same records.

    Under the null hypothesis the signs of the differences are exchangeable: this is a sign-flip permutation
    test. It assumes no distribution, so that a few failed chains decide nothing. All others are compared with
    the same signs (Westfall and Young 1993): the greatest of their statistics is what the chance is of, and
    many that resemble each other cost no more than one.

    Parameters
    ----------
    before : ndarray, shape (n,)
        Losses of the model that is there, at least 0.
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
"""Newest records on which trees are compared: few tell soon of a changed robot, many of small things."""
FEWEST_TESTED = 12
LEVEL = 0.05
"""Chance, over all candidates of one round, of taking up a tree that is no better; over those that were in
use before it is the same."""
_FOLDS = 3
_REMEMBERED = 300
_NO_LOSS = 1e-9
_AS_GOOD = 0.05
"""Chance from which on one candidate counts as no better than another."""


@dataclass(frozen=True)
class RoundVerdict:
    """What a round of learning found out about one measure of an action.

    Attributes
    ----------
    episodes : int
        Number of records of the measure.
    tested : int
        The newest of them on which trees were compared, and which none of these had seen.
    reason : str
        Why the tree stays or is replaced, in a sentence.
    kind : str
        How the better tree came about; empty where there is none.
    before, after, chance
        As in `Comparison`, for the best candidate; None where none was compared or there was no tree.
        Losses are absolute errors (s, m, rad), of success squared ones (Brier score).
    tree : ModelTree or None
        The better one.
    error : float or None
        Usual error of its predictions on the tested records, which it had not seen.
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
    lessons: Lessons,
    names: Sequence[str],
    *,
    now: ModelTree | None,
    seen: int,
    former: Mapping[str, ModelTree],
) -> RoundVerdict:
    """Compare the tree of a measure with all candidates on the newest records, which it has not seen.

    These are parted. Of each part candidates predict what they learned from all other records, so they know
    the robot as it is now. A candidate that is better is learned again from all of them.

    Parameters
    ----------
    lessons : Lessons
        The records.
    names : sequence of str
        Features to learn from.
    now : ModelTree or None
        The tree in use.
    seen : int
        Number from which on records are new to it.
    former : mapping
        Trees that were in use before, by the names of their sets; those shipped, too.
    """
    count = len(lessons.values)
    test = np.flatnonzero(lessons.numbers >= seen)[-max(TESTED) :][::-1]  # newest first
    if len(test) < FEWEST_TESTED:
        told = "" if lessons.measure == "success" else " that succeeded"
        return RoundVerdict(
            count, len(test), f"too few new records: {len(test)}, expected {FEWEST_TESTED}{told}"
        )
    known = {"the present model": now} if now is not None else {}
    tried = _predictions(lessons, list(candidates(lessons, names, known, former)), test)
    if not tried:
        rest = count - math.ceil(len(test) / _FOLDS)
        why = "what was learned predicts no numbers"
        if rest < FEWEST_LEARNED:
            why = f"too few records: {rest} without those that are predicted, expected {FEWEST_LEARNED}"
        return RoundVerdict(count, len(test), why)
    if lessons.measure == "success" and now is not None:
        tried = [item for item in tried if _remembers(lessons, item[0], now, test)]
        if not tried:
            return RoundVerdict(count, len(test), "no better: what was learned forgets earlier failures")
    before = lessons.losses(_usual(lessons, now, test), test)
    sizes = sorted({min(size, len(test)) for size in TESTED})
    for size in sizes:
        level = LEVEL / len(sizes)
        verdict = _verdict(lessons, tried, before, test[:size], level=level, present=now is not None)
        if verdict.tree is not None:
            break
    return verdict


def _usual(lessons: Lessons, now: ModelTree | None, test: IntArray) -> FloatArray:
    """Return what is predicted without the candidates; without a tree the best constant of other records."""
    if now is not None:
        return lessons.predicted(now, test)
    others = np.setdiff1d(np.arange(len(lessons.values)), test)
    values = lessons.values[others if len(others) >= FEWEST_TESTED else slice(None)]
    middle = np.mean(values) if lessons.measure == "success" else np.median(values)
    return np.full(len(test), float(middle))


def _predictions(
    lessons: Lessons, tried: Sequence[TreeCandidate], test: IntArray
) -> list[tuple[TreeCandidate, FloatArray]]:
    """Return the candidates that can be learned, and what they predict of the tested records."""
    everything = np.arange(len(lessons.values))
    predictions = []
    for candidate in tried:
        predicted = np.full(len(test), np.nan)
        folds = 1 if candidate.slow else _FOLDS
        for fold in range(folds):
            part = slice(fold, None, folds)
            tree = candidate.learn(np.setdiff1d(everything, test[part], assume_unique=True))
            if tree is not None:
                predicted[part] = lessons.predicted(tree, test[part])
        if np.isfinite(predicted).all():
            predictions.append((candidate, predicted))
    return predictions


def _remembers(lessons: Lessons, candidate: TreeCandidate, now: ModelTree, test: IntArray) -> bool:
    """Return whether a candidate predicts earlier records as well as the present tree does.

    Chains predicted to fail are no longer executed. Then nothing fails, and a tree that predicts no failures
    would soon seem better.
    """
    which = np.arange(len(lessons.values))[-_REMEMBERED:]
    tree = _learned_again(lessons, candidate, test)
    before, after = (np.mean(lessons.losses(lessons.predicted(t, which), which)) for t in (now, tree))
    return bool(after <= before + _NO_LOSS)


def _verdict(
    lessons: Lessons,
    tried: Sequence[tuple[TreeCandidate, FloatArray]],
    before: FloatArray,
    test: IntArray,
    *,
    level: float,
    present: bool,
) -> RoundVerdict:
    losses = [lessons.losses(predicted[: len(test)], test) for _, predicted in tried]
    names = [candidate.name for candidate, _ in tried]
    number, compared = _best(names, before[: len(test)], losses, level)
    best = compared[number]
    name, unit = names[number], MEASURES[lessons.measure]
    figures = f"{best.before:.3g} to {best.after:.3g}{unit and f' {unit}'} on {len(test)} records"
    told = (len(lessons.values), len(test))
    loss = "Brier score" if lessons.measure == "success" else "error"
    before_told = best.before if present else None
    if not _is_better(best, level):
        reason = f"no better: {name} would change the {loss} from {figures} (chance {best.chance:.3f})"
        return RoundVerdict(*told, reason, "", before_told, best.after, best.chance)
    tree = _learned_again(lessons, tried[number][0], test)
    error = 1.4826 * float(np.median(losses[number]))  # not what single chains that went wrong make it
    return RoundVerdict(
        *told, f"{name}: {loss} from {figures}", name, before_told, best.after, best.chance, tree, error
    )


def _learned_again(lessons: Lessons, candidate: TreeCandidate, test: IntArray) -> ModelTree:
    which = np.arange(len(lessons.values))
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
        # Of those that are as good as the best, the first: it knows most, and few records tell little of it.
        if number == least or compare(losses[number], losses[least][:, None])[0].chance >= _AS_GOOD:
            return number, compared
    return least, compared


def _is_better(compared: Comparison, level: float) -> bool:
    return compared.after < compared.before and compared.chance < level
