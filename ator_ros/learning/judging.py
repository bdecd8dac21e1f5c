"""Which tree predicts a measure of an action best, and whether that is more than noise explains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.learning.candidates import BACK, Candidate, candidates
from ator_ros.learning.comparison import Comparison, compare
from ator_ros.learning.lessons import Lessons
from ator_ros.performance.model import MEASURES
from ator_ros.performance.tree.nodes import IntArray, ModelTree

TESTED = (25, 100)
"""Newest records on which trees are compared: few tell soon of a changed robot, many of small things."""
FEWEST_TESTED = 12
LEVEL = 0.02
"""Chance, over all candidates of one round, of taking up a tree that is no better."""
BACK_LEVEL = 0.05
"""The same for a tree that was in use before: a set that turns out worse is given up sooner."""
_FOLDS = 3
_AS_GOOD = 0.05
"""Chance from which on one candidate counts as no better than another."""


@dataclass(frozen=True)
class RoundVerdict:
    """What a round of learning found out about one measure of an action.

    Attributes
    ----------
    episodes : int
        Records there are that tell of the measure.
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
        return RoundVerdict(count, len(test), "no model can be learned yet")
    if now is not None:
        usual = lessons.predicted(now, test)
    else:
        usual = np.full(len(test), _middle(lessons, test))
    before = lessons.losses(usual, test)
    for tested in dict.fromkeys(min(size, len(test)) for size in TESTED):
        verdict = _verdict(lessons, tried, before, test[:tested], present=now is not None)
        if verdict.tree is not None:
            break
    return verdict


def _middle(lessons: Lessons, test: IntArray) -> float:
    """Return the best constant prediction that the records before the tested ones tell."""
    others = np.setdiff1d(np.arange(len(lessons.values)), test)
    values = lessons.values[others if len(others) >= FEWEST_TESTED else slice(None)]
    return float(np.mean(values) if lessons.measure == "success" else np.median(values))


def _predictions(
    lessons: Lessons, tried: Sequence[Candidate], test: IntArray
) -> list[tuple[Candidate, FloatArray]]:
    """Return the candidates that can be learned, and what they predict of the tested records."""
    everything = np.arange(len(lessons.values))
    predictions = []
    for candidate in tried:
        predicted = np.full(len(test), np.nan)
        folds = 1 if candidate.once else _FOLDS
        for fold in range(folds):
            part = slice(fold, None, folds)
            tree = candidate.learn(np.setdiff1d(everything, test[part], assume_unique=True))
            if tree is not None:
                predicted[part] = lessons.predicted(tree, test[part])
        if np.isfinite(predicted).all():
            predictions.append((candidate, predicted))
    return predictions


def _verdict(
    lessons: Lessons,
    tried: Sequence[tuple[Candidate, FloatArray]],
    before: FloatArray,
    test: IntArray,
    *,
    present: bool,
) -> RoundVerdict:
    losses = [lessons.losses(predicted[: len(test)], test) for _, predicted in tried]
    number, compared = _best([candidate.name for candidate, _ in tried], before[: len(test)], losses)
    best = compared[number]
    name, unit = tried[number][0].name, MEASURES[lessons.measure]
    figures = f"{best.before:.3g} to {best.after:.3g}{unit and f' {unit}'} on {len(test)} records"
    told = (len(lessons.values), len(test))
    loss = "Brier score" if lessons.measure == "success" else "error"
    before_told = best.before if present else None
    if not _is_better(name, best):
        reason = f"no better: {name} would change the {loss} from {figures} (chance {best.chance:.3f})"
        return RoundVerdict(*told, reason, "", before_told, best.after, best.chance)
    tree = _learned_again(lessons, tried[number][0], test)
    error = 1.4826 * float(np.median(losses[number]))  # not what single chains that went wrong make it
    return RoundVerdict(
        *told, f"{name}: {loss} from {figures}", name, before_told, best.after, best.chance, tree, error
    )


def _learned_again(lessons: Lessons, candidate: Candidate, test: IntArray) -> ModelTree:
    which = np.arange(len(lessons.values))
    tree = candidate.learn(np.setdiff1d(which, test) if candidate.once else which)
    assert tree is not None  # it was learned from fewer records
    return tree


def _best(
    names: Sequence[str], before: FloatArray, losses: Sequence[FloatArray]
) -> tuple[int, list[Comparison]]:
    """Return the number of the best candidate, significant ones first, and all comparisons."""
    compared: list[Comparison] = [Comparison(0.0, 0.0, 1.0)] * len(names)
    for back in (False, True):
        group = [number for number, name in enumerate(names) if name.startswith(BACK) == back]
        if group:
            results = compare(before, np.column_stack([losses[number] for number in group]))
            for number, result in zip(group, results, strict=True):
                compared[number] = result
    better = [number for number, name in enumerate(names) if _is_better(name, compared[number])]
    least = min(better or range(len(names)), key=lambda number: compared[number].after)
    for number in better:
        # Of those that are as good as the best, the first: it knows most, and few records tell little of it.
        if number == least or compare(losses[number], losses[least][:, None])[0].chance >= _AS_GOOD:
            return number, compared
    return least, compared


def _is_better(name: str, compared: Comparison) -> bool:
    level = BACK_LEVEL if name.startswith(BACK) else LEVEL
    return compared.after < compared.before and compared.chance * len(TESTED) < level
