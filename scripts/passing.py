"""What passing gains: a table of an evaluation with the policies stepwise, passing and refined.

Run it with the folder of the evaluation:

scripts/run python scripts/passing.py rounds/passing
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

from ator_ros.performance.accuracy import mean_ci95

POLICIES = ("stepwise", "passing", "refined")
SLOWER = 1.05
"""Ratio of durations above which a round counts as slower."""


def row(name: str, durations: dict[str, np.ndarray]) -> str:
    """Return a policy's row: duration, gain and its interval, slower rounds, share of the oracle.

    `durations` are those in s of each policy, and of the oracle, shape (n,).
    """
    reference = durations["stepwise"]
    own = durations[name]
    gain = 100.0 * (reference - own) / reference.mean()
    low, high = mean_ci95(gain)
    share = (reference - own).sum() / (reference - durations["oracle"]).sum()
    slower = int((own > SLOWER * reference).sum())
    return (
        f"| {name} | {own.mean():.2f} s | {gain.mean():.1f} % ({low:.1f} to {high:.1f}) "
        f"| {slower} of {len(own)} | {100.0 * share:.0f} % |"
    )


def main(folder: str) -> None:
    """Print the table of an evaluation."""
    content = json.loads((Path(folder) / "evaluation.json").read_text(encoding="utf-8"))
    runs = content["runs"]["policies"]
    failed = {name: runs[name]["success"].count(False) for name in POLICIES}
    durations = {name: np.array(runs[name]["duration"]) for name in POLICIES}
    durations["oracle"] = np.minimum.reduce(list(durations.values()))
    print("| policy | mean | gain (95 %) | more than 5 % slower | of the oracle's gain |")
    print("| --- | --- | --- | --- | --- |")
    for name in (*POLICIES, "oracle"):
        print(row(name, durations))
    print(f"failed: {failed}")


if __name__ == "__main__":
    main(*sys.argv[1:])
