"""What order and passing gain: the tables of docs/rounds.md, from evaluations of the chain `round`.

Run it with the folders of evaluations that compare orders, or with that of one that compares
passing with stops:

scripts/run python scripts/rounds.py rounds/tour rounds/pursuit rounds/building
scripts/run python scripts/rounds.py rounds/passing
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ator_ros.evaluation.running import KIND, RESULT
from ator_ros.files import load
from ator_ros.geometry import FloatArray
from ator_ros.performance.accuracy import resampled_means

ORDERS: Mapping[str, str] = {
    "listed_fixed": "as listed | 0",
    "listed": "as listed | naive",
    "listed_refined": "as listed | refined",
    "nearest_refined": "nearest station next | refined",
    "straight_refined": "shortest by straight lines | refined",
    "route_refined": "shortest by routes on the map | refined",
    "refined": "by predicted time, with the headings | refined",
}
"""Order and headings of each policy."""
STOPS: Mapping[str, str] = {
    "stepwise": "a stop at each",
    "passing": "all passed but the last one",
    "refined": "as predicted, together with order and headings",
    "oracle": "the best of the three",
}
"""Stops of each policy."""
SLOWER_ORDER = 1.02
SLOWER_PASSING = 1.05
"""Ratios of durations above which a round counts as slower."""


@dataclass(frozen=True)
class Rounds:
    """An evaluation of rounds.

    Attributes
    ----------
    domain : str
        The domain.
    durations : Mapping of str to array of float
        By policy: the duration of each round in s.
    failures : int
        Number of rounds that failed, of all policies.
    command : str
        The command that made the evaluation.
    """

    domain: str
    durations: Mapping[str, FloatArray]
    failures: int
    command: str

    @classmethod
    def read(cls, folder: Path) -> Rounds:
        """Read the evaluation in a folder; raise FileError if it cannot be read."""
        content = load(folder / RESULT, KIND, dict[str, Any])
        policies = content["runs"]["policies"]
        return cls(
            content["settings"]["source"]["domain"],
            {name: np.array(runs["duration"]) for name, runs in policies.items()},
            sum(runs["success"].count(False) for runs in policies.values()),
            content["summary"]["command"],
        )

    def gain(self, name: str, reference: str) -> str:
        """Return the share of the reference's total time that a policy saves, with its interval."""
        pair = np.stack((self.durations[reference], self.durations[name]))
        saved = _saved_percent(*pair.mean(axis=1))
        low, high = np.percentile(_saved_percent(*resampled_means(pair)), (2.5, 97.5))
        return f"{saved:.1f} % ({low:.1f} to {high:.1f})"

    def slower(self, name: str, reference: str, ratio: float) -> int:
        """Return how many rounds of a policy take more than `ratio` times the reference's time."""
        return int(np.sum(self.durations[name] > ratio * self.durations[reference]))

    def caption(self) -> str:
        """Return from what the table is made."""
        count = len(self.durations["naive"])
        return f"{self.domain}: {count} rounds, {self.failures} failed; `{self.command}`"


def _saved_percent(reference: FloatArray, own: FloatArray) -> FloatArray:
    return 100.0 * (1.0 - own / reference)


def table_of_orders(evaluations: Sequence[Rounds]) -> list[str]:
    """Return a table with a row for each order, and two columns for each evaluation.

    The last two rows compare the order by predicted times with the shortest by routes.
    """
    head = ["order | headings"]
    head += [f"`{rounds.domain}` | gain (95 %)" for rounds in evaluations]
    rows = []
    for name, label in ORDERS.items():
        row = [label]
        for rounds in evaluations:
            gain = "" if name == "listed" else rounds.gain(name, "listed")
            row.append(f"{rounds.durations[name].mean():.2f} s | {gain}")
        rows.append(row)
    saved = ["saved by predicted time, against the shortest by routes | refined"]
    slower = ["rounds in which it is more than 2 % slower | refined"]
    for rounds in evaluations:
        means = [rounds.durations[name].mean() for name in ("route_refined", "refined")]
        saved.append(f"{means[0] - means[1]:.2f} s | {rounds.gain('refined', 'route_refined')}")
        count = rounds.slower("refined", "route_refined", SLOWER_ORDER)
        number = len(rounds.durations["refined"])
        slower.append(f"{count} of {number} | {100.0 * count / number:.1f} %")
    return _table(head, [*rows, saved, slower])


def table_of_stops(rounds: Rounds) -> list[str]:
    """Return a table with a row for each policy, and for an oracle that executes all of them."""
    durations = dict(rounds.durations)
    durations["oracle"] = np.minimum.reduce([durations[name] for name in STOPS if name != "oracle"])
    rounds = Rounds(rounds.domain, durations, rounds.failures, rounds.command)
    means = {name: values.mean() for name, values in durations.items()}
    possible = means["stepwise"] - means["oracle"]
    rows = []
    for name, label in STOPS.items():
        row = [label, f"{means[name]:.2f} s"]
        if name == "stepwise":
            row += ["", "", ""]
        else:
            count = rounds.slower(name, "stepwise", SLOWER_PASSING)
            share = 100.0 * (means["stepwise"] - means[name]) / possible
            row.append(rounds.gain(name, "stepwise"))
            row.append(f"{count} of {len(durations[name])}")
            row.append(f"{share:.0f} %")
        rows.append(row)
    head = ["stations", "mean", "gain (95 %)", "more than 5 % slower", "of the oracle's gain"]
    return _table(head, rows)


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the lines of a table in Markdown."""
    columns = " | ".join(head).count("|") + 1
    lines = [" | ".join(head), " | ".join(["---"] * columns)]
    lines += [" | ".join(row) for row in rows]
    return [f"| {line} |" for line in lines]


def main(folders: Sequence[str]) -> None:
    """Print the table of evaluations, and from what it is made."""
    evaluations = [Rounds.read(Path(folder)) for folder in folders]
    if "stepwise" in evaluations[0].durations:
        (rounds,) = evaluations
        lines = table_of_stops(rounds)
    else:
        lines = table_of_orders(evaluations)
    lines += [rounds.caption() for rounds in evaluations]
    print("\n".join(lines))


if __name__ == "__main__":
    main(sys.argv[1:])
