"""Trees worth trying in place of the one that predicts a measure now."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ator_ros.learning.correcting import constant, corrected, scaled_to
from ator_ros.learning.lessons import Lessons
from ator_ros.performance.training import SMALL_LEAF, duration_tree, small_tree
from ator_ros.performance.tree.nodes import IntArray, ModelTree

WINDOWS = (100, 300, 1000)
"""Newest records from which a tree is learned; a change of the robot shows in the records after it."""
BACK = "back to "
"""How the name of a candidate begins that was in use before."""
_RECENT = (30, 100)
"""Newest records from which corrections are estimated."""
FEWEST_LEARNED = 20
"""Records from which a tree can be learned."""
_FEWEST = 12
"""Records from which one can be corrected."""
_LEAST_LEAF = 8
"""Records in a leaf."""
_LARGE = 2000
"""Records from which learning takes so long that a tree is tested without being learned again."""


@dataclass(frozen=True)
class TreeCandidate:
    """A way to come by a tree.

    Attributes
    ----------
    name : str
        How, in words.
    learn : callable
        Returns the tree that comes of the records with these positions (oldest first); None where they are
        too few.
    slow : bool
        Whether learning it again for each part of the test records, and for good, would take too long.
    """

    name: str
    learn: Callable[[IntArray], ModelTree | None]
    slow: bool = False


def candidates(
    lessons: Lessons,
    names: Sequence[str],
    known: Mapping[str, ModelTree],
    former: Mapping[str, ModelTree],
) -> Iterator[TreeCandidate]:
    """Yield candidates, those that know most first.

    Parameters
    ----------
    lessons : Lessons
        The records.
    names : sequence of str
        Features to learn from.
    known, former : mapping
        Trees that are used now and that were in use before, by the names of their sets. Former ones are
        candidates as they are. Of times, copies of all of them that are scaled, shifted or corrected to fit
        the newest records are candidates too.
    """
    for name, tree in former.items():
        yield TreeCandidate(f"{BACK}{name}", partial(_kept, tree))
    count = len(lessons.values)
    if lessons.measure == "success":
        for size in (count, *reversed([size for size in WINDOWS if size < 0.8 * count])):
            yield TreeCandidate(f"the rate of {size} episodes", partial(_rate, lessons, size))
    for size in (count, *reversed([size for size in WINDOWS if size < 0.8 * count])):
        learn = partial(_learned, lessons, list(names), size)
        yield TreeCandidate(f"learned from {size} episodes", learn, slow=size > _LARGE)
    if lessons.measure != "duration":
        return
    for name, tree in {**known, **former}.items():
        for size in _RECENT:
            if size == _RECENT[0] or count > _RECENT[0]:
                told = f"to {min(size, count)} episodes"
                yield TreeCandidate(
                    f"{name} corrected {told}", partial(_fitted, corrected, lessons, tree, size)
                )
                yield TreeCandidate(f"{name} scaled {told}", partial(_fitted, scaled_to, lessons, tree, size))


def _kept(tree: ModelTree, _: IntArray) -> ModelTree:
    return tree


def _rate(lessons: Lessons, size: int, which: IntArray) -> ModelTree:
    """Return the share that succeeded; a few failures make leaves of any shape, which repel refinement."""
    values = lessons.values[which[-size:]]
    return constant(lessons.table.columns[0], float(np.mean(values)), len(values))


def _learned(lessons: Lessons, names: list[str], size: int, which: IntArray) -> ModelTree | None:
    which = which[-size:]
    if len(which) < FEWEST_LEARNED:
        return None
    table, values = lessons.table[names].iloc[which], lessons.values[which]
    if lessons.measure == "duration":
        return duration_tree(table, values)
    # Failures are rare, so small leaves are allowed.
    leaf = int(np.clip(len(which) // 6, _LEAST_LEAF, SMALL_LEAF))
    return small_tree(table, values, leaf=leaf)


def _fitted(
    fit: Callable[[Lessons, ModelTree, IntArray], ModelTree],
    lessons: Lessons,
    tree: ModelTree,
    size: int,
    which: IntArray,
) -> ModelTree | None:
    which = which[-size:]
    return fit(lessons, tree, which) if len(which) >= _FEWEST else None
