"""The executed chains: predicted and actual durations, and gains of refinement."""

from __future__ import annotations

import itertools
import math
import re
from collections import deque
from dataclasses import dataclass

import numpy as np

from ator_ros.geometry import Pose
from ator_ros.printable import printable

_MOST = 500
_SHOWN = 12
_RECENT = 20
_SAME = 0.05  # m and rad up to which two starts or goals count as the same
_MARKDOWN = re.compile(r"([\\`*_{}\[\]<>#|~$!])")


def plain(text: str, most: int = 300) -> str:
    """Return a text escaped for Markdown."""
    return _MARKDOWN.sub(r"\\\1", printable(text, most))


def seconds(value: float) -> str:
    """Return a number of seconds for a table; `-` if it is unknown."""
    return "-" if math.isnan(value) else f"{value:.2f}"


@dataclass(frozen=True, slots=True)
class ExecutedChain:
    """One executed chain: its TOPs, whether refinement changed it, and how it ended.

    `predicted` and `actual` are its duration in s as predicted at the start, and as measured; NaN if unknown,
    or if it failed. `places` are where robot and objects were at the start, and the chain's last goal.
    """

    tops: tuple[str, ...]
    refined: bool
    predicted: float
    actual: float
    outcome: str
    places: tuple[Pose, ...]

    @property
    def error(self) -> float:
        """Predicted less actual duration in s; NaN if one is unknown."""
        return self.predicted - self.actual

    def repeats(self, other: ExecutedChain) -> bool:
        """Return whether it had the same TOPs, start and goal as another one."""
        return (
            self.tops == other.tops
            and len(self.places) == len(other.places)
            and all(
                a.distance(b) < _SAME and abs(a.relative(b).yaw) < _SAME
                for a, b in zip(self.places, other.places, strict=True)
            )
        )


class History:
    """Executed chains, the newest last; one thread may add while another reads."""

    def __init__(self) -> None:
        self._chains: deque[tuple[ExecutedChain, float]] = deque(maxlen=_MOST)

    def add(self, chain: ExecutedChain) -> None:
        """Add a chain that has ended."""
        gain = math.nan
        if chain.refined:
            naive = (other for other, _ in reversed(self._chains) if not other.refined)
            gain = next((other.actual - chain.actual for other in naive if chain.repeats(other)), math.nan)
        self._chains.append((chain, gain))

    def report(self, learned: str = "") -> str:
        """Return, in Markdown, the mean error and gain, the learned models, and the newest chains."""
        rows = tuple(self._chains)
        if not rows:
            return "no chain was executed yet"
        lines = [f"{len(rows)} chains, {sum(chain.refined for chain, _ in rows)} of them refined.", ""]
        errors = [chain.error for chain, _ in rows[-_RECENT:] if math.isfinite(chain.error)]
        if errors:
            size, bias = float(np.mean(np.abs(errors))), float(np.mean(errors))
            lines += [
                f"Model error, last {len(errors)}: {size:.2f} s, mean {bias:+.2f} s (predicted - actual).",
                "",
            ]
        gains = [gain for _, gain in rows if math.isfinite(gain)]
        if gains:
            mean = f"{np.mean(gains):+.2f} s, mean of {len(gains)}"
            lines += [f"Gain over the naive chain from the same start: {mean}.", ""]
        if learned:
            lines += [f"Learned models: {plain(learned, 600)}.", ""]
        lines += ["| | chain | predicted | actual | gain |", "|---|---|---|---|---|"]
        newest = itertools.islice(reversed(list(enumerate(rows, 1))), _SHOWN)
        return "\n".join([*lines, *(_row(number, *row) for number, row in newest)])


def _row(number: int, chain: ExecutedChain, gain: float) -> str:
    name = f"{plain(', '.join(chain.tops))} ({'refined' if chain.refined else 'as sent'})"
    actual = f"{chain.actual:.2f}" if math.isfinite(chain.actual) else plain(chain.outcome)
    return f"| {number} | {name} | {seconds(chain.predicted)} | {actual} | {seconds(gain)} |"
