"""The chains that a view saw executed: predicted against actual times, and what refinement gained."""

from __future__ import annotations

import itertools
import math
import operator
from collections import defaultdict, deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ator_ros.geometry import FloatArray, Pose
from ator_ros.viewing.markdown import plain, seconds

_MOST = 500
_SHOWN = 12
_RECENT = 20
_SAME = 0.05
"""Distance in m, and difference in rad, up to which two starts or goals count as the same."""
_LOOKED_AT = 50
"""Chains with the robot in about the same place of which one is looked for that a chain repeats."""


@dataclass(frozen=True, slots=True)
class Driven:
    """One executed chain.

    Attributes
    ----------
    ended : float
        Stamp in s of its end.
    tops : tuple of str
        Names of its TOPs.
    refined : bool
        Whether refinement changed it.
    predicted, actual : float
        Duration in s as predicted at the start, and as it was; NaN where unknown, or where it failed.
    outcome : str
        How it ended.
    start : tuple of Pose
        Where the robot and the objects were, and where the chain ends.
    """

    ended: float
    tops: tuple[str, ...]
    refined: bool
    predicted: float
    actual: float
    outcome: str
    start: tuple[Pose, ...]

    @property
    def error(self) -> float:
        """Predicted less actual duration in s; NaN where one is not known."""
        return self.predicted - self.actual

    def repeats(self, other: Driven) -> bool:
        """Return whether it had the same start, TOPs and end as another one."""
        places = zip(self.start, other.start, strict=False)
        return (
            self.tops == other.tops
            and len(self.start) == len(other.start)
            and all(a.distance(b) < _SAME and abs(a.relative(b).yaw) < _SAME for a, b in places)
        )


class History:
    """Executed chains, the newest last; one thread adds while another reads.

    Attributes
    ----------
    edition : int
        Grows with every chain.
    """

    def __init__(self) -> None:
        self._chains: deque[Driven] = deque(maxlen=_MOST)
        self.edition = 0

    def add(self, driven: Driven) -> None:
        """Add a chain that has ended."""
        self._chains.append(driven)
        self.edition += 1

    @property
    def chains(self) -> tuple[Driven, ...]:
        """The chains, the oldest first."""
        return tuple(self._chains)

    def curves(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return number, predicted and actual duration in s of the chains for which both are known."""
        known = [(n, c.predicted, c.actual) for n, c in enumerate(self.chains, 1) if math.isfinite(c.error)]
        numbers, predicted, actual = np.array(known, dtype=float).reshape(-1, 3).T
        return numbers, predicted, actual


class _AsPlanned:
    """Finds the last unrefined chain that another one repeats.

    They are kept by TOPs and the square in which the robot started, so that the time for each does not grow
    with their number.
    """

    def __init__(self) -> None:
        self._kept = defaultdict[tuple[object, ...], deque[tuple[int, Driven]]](
            lambda: deque(maxlen=_LOOKED_AT)
        )

    def add(self, number: int, chain: Driven) -> None:
        """Add an unrefined chain; `number` grows."""
        self._kept[(chain.tops, *_square(chain))].append((number, chain))

    def last_like(self, chain: Driven) -> Driven | None:
        """Return the last one that `chain` repeats; None if there is none."""
        alike = (kept for square in _squares_around(chain) for kept in self._kept.get(square, ()))
        _, found = max(
            ((number, other) for number, other in alike if chain.repeats(other)),
            key=lambda kept: kept[0],
            default=(0, None),
        )
        return found


def _square(chain: Driven) -> tuple[int, ...]:
    """Return in which square of the floor the robot started; empty where that is not known."""
    return tuple(math.floor(at / _SAME) for at in chain.start[0][:2]) if chain.start else ()


def _squares_around(chain: Driven) -> Iterator[tuple[object, ...]]:
    """Yield the keys of all chains that `chain` might repeat."""
    square = _square(chain)
    for off in itertools.product((-1, 0, 1), repeat=len(square)):
        yield (chain.tops, *map(operator.add, square, off))


def gains(chains: Sequence[Driven]) -> tuple[float, ...]:
    """Return, chain by chain, by how many s a refined one was faster than the last unrefined one like it.

    NaN where it was not refined, or nothing like it was driven before.
    """
    found, planned = [], _AsPlanned()
    for number, chain in enumerate(chains):
        like = planned.last_like(chain) if chain.refined else None
        found.append(math.nan if like is None else like.actual - chain.actual)
        if not chain.refined:
            planned.add(number, chain)
    return tuple(found)


def told(chains: Sequence[Driven], learned: str = "") -> str:
    """Return, in Markdown, the mean error and gain, the set of models in use, and the newest chains."""
    if not chains:
        return "no chain was executed yet"
    won = gains(chains)
    errors = [chain.error for chain in chains[-_RECENT:] if math.isfinite(chain.error)]
    all_won = [gain for gain in won if math.isfinite(gain)]
    lines = [f"{len(chains)} chains, {sum(chain.refined for chain in chains)} of them refined.", ""]
    if errors:
        size, lean = float(np.mean(np.abs(errors))), float(np.mean(errors))
        told_of = f"Model error, last {len(errors)}: {size:.2f} s, mean {lean:+.2f} s"
        lines += [f"{told_of} (predicted - actual).", ""]
    if all_won:
        lines += [
            f"Gain over the naive chain from the same start: {np.mean(all_won):+.2f} s, "
            f"mean of {len(all_won)}.",
            "",
        ]
    if learned:
        lines += [f"Learned models: {plain(learned, 600)}.", ""]
    lines += ["| | chain | predicted | actual | gain |", "|---|---|---|---|---|"]
    newest = list(zip(range(1, len(chains) + 1), chains, won, strict=True))[-_SHOWN:]
    lines += [_row(number, chain, gain) for number, chain, gain in reversed(newest)]
    return "\n".join(lines)


def _row(number: int, chain: Driven, gain: float) -> str:
    kind = "refined" if chain.refined else "as sent"
    actual = f"{chain.actual:.2f}" if math.isfinite(chain.actual) else plain(chain.outcome)
    cells = (
        number,
        f"{plain(', '.join(chain.tops))} ({kind})",
        seconds(chain.predicted),
        actual,
        seconds(gain),
    )
    return f"| {' | '.join(map(str, cells))} |"
