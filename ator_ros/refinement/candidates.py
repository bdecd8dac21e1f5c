"""Tables of candidates, shape (n, k): where one is among them."""

from __future__ import annotations

import numpy as np

from ator_ros.geometry import BoolArray, FloatArray


def place_of(*pairs: tuple[FloatArray, FloatArray]) -> int | None:
    """Return the first row in which each table (n or 1, k) equals its candidate (k,); None if none does.

    The first row does where nothing is free.
    """
    same: BoolArray | None = None
    for table, candidate in pairs:
        for column, value in enumerate(candidate.tolist()):
            equal: BoolArray = table[:, column] == value
            same = equal if same is None else same & equal
    if same is None:
        return 0
    place = int(same.argmax())
    return place if same[place] else None


def with_candidate(table: FloatArray, candidate: FloatArray) -> FloatArray:
    """Return a table and, after it, a candidate, where that is not among it already."""
    there = place_of((table, candidate)) is not None
    return table if there else np.concatenate((table, candidate[None, :]))
