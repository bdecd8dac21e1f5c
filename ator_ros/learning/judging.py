"""Which model of an action predicts the newest records best, and whether that is more than noise."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from ator_ros.experience.store_reading import NUMBER
from ator_ros.geometry import FloatArray
from ator_ros.learning.candidates import BACK, candidates, plausible, predicted, with_honest_spread
from ator_ros.learning.comparison import Comparison, compare
from ator_ros.performance.features import Feature
from ator_ros.performance.model import PerformanceModel
from ator_ros.robot.description import Robot

TESTED = (15, 50)
"""Newest records on which models are compared: few tell soon of a changed robot, many of small things."""
FEWEST_TESTED = 12
LEVEL = 0.01
"""Chance, over all candidates of one round, of taking up a model that is no better."""
BACK_LEVEL = 0.05
"""The same for a model that was in use before: a set that turns out worse is given up sooner."""
_AS_GOOD = 0.05
"""Chance from which on one candidate counts as no better than another."""


@dataclass(frozen=True)
class RoundVerdict:
    """What a round of learning found out about one action.

    Attributes
    ----------
    episodes : int
        Records there are.
    tested : int
        The newest of them on which models were compared, and which none of these had seen.
    reason : str
        Why the model stays or is replaced, in a sentence.
    kind : str
        How the better model came about; empty where there is none.
    before, after, chance
        As in `Comparison`, for the best candidate; None where none was compared or there was no model.
    model : PerformanceModel or None
        The better one.
    """

    episodes: int
    tested: int
    reason: str
    kind: str = ""
    before: float | None = None
    after: float | None = None
    chance: float | None = None
    model: PerformanceModel | None = None


def judge(
    action: str,
    rows: pd.DataFrame,
    robot: Robot,
    features: Sequence[Feature],
    *,
    now: PerformanceModel | None,
    seen: int,
    former: Mapping[str, PerformanceModel],
) -> RoundVerdict:
    """Compare the model of an action with all candidates on the newest records.

    Of the newest records, which the present model has not seen, every second is for testing, and the
    candidates learn from all others: so they know the robot as it is now.

    Parameters
    ----------
    action : str
        Name of the action.
    rows : pandas.DataFrame
        Starts of its episodes, oldest first, with `NUMBER`.
    robot, features
        As for `train`.
    now : PerformanceModel or None
        The model in use.
    seen : int
        Number from which on records are new to it.
    former : mapping
        Models that were in use before, by the names of their sets; those shipped, too.
    """
    rows = plausible(rows)
    fresh = rows[rows[NUMBER] >= seen]
    test = fresh[-2 * max(TESTED) :][::-1][::2]
    lesson = rows[~rows[NUMBER].isin(test[NUMBER])]
    test = test[test["success"]]
    if len(test) < FEWEST_TESTED:
        wanted = f"{2 * FEWEST_TESTED} that succeeded"
        return RoundVerdict(
            len(rows), len(test), f"too few new records: {len(fresh)}, expected about {wanted}"
        )
    known = {"the present model": now} if now is not None else {}
    tried = [(f"{BACK}{name}", model) for name, model in former.items()]
    tried += candidates(action, lesson, robot, features, {**known, **former})
    if not tried:
        return RoundVerdict(len(rows), len(test), "no model can be learned yet")
    good = lesson[lesson["success"]]["duration"]
    middle = float(good.median()) if len(good) else 0.0
    for tested in TESTED:
        part = test[:tested]
        usual = predicted(now, part) if now is not None else np.full(len(part), middle)
        verdict = _verdict(tried, part, usual, present=now is not None, episodes=len(rows))
        if verdict.model is not None:
            break
    return verdict


def _verdict(
    tried: Sequence[tuple[str, PerformanceModel]],
    test: pd.DataFrame,
    usual: FloatArray,
    *,
    present: bool,
    episodes: int,
) -> RoundVerdict:
    actual = test["duration"].to_numpy(dtype=float)
    best, kind, compared = _best(actual, usual, tried, test)
    before = compared.before if present else None
    figures = f"{compared.before:.3f} s to {compared.after:.3f} s on {len(test)} records"
    if best is None:
        reason = f"no better: {kind} would change the error from {figures} (chance {compared.chance:.3f})"
        return RoundVerdict(episodes, len(test), reason, "", before, compared.after, compared.chance)
    reason = f"{kind}: error from {figures}"
    model = with_honest_spread(best, test)
    return RoundVerdict(episodes, len(test), reason, kind, before, compared.after, compared.chance, model)


def _best(
    actual: FloatArray,
    usual: FloatArray,
    tried: Sequence[tuple[str, PerformanceModel]],
    test: pd.DataFrame,
) -> tuple[PerformanceModel | None, str, Comparison]:
    """Return the best significant candidate or None, the name of the best candidate, and its comparison."""
    errors = {name: actual - predicted(model, test) for name, model in tried}
    compared = {name: compare(actual - usual, error) for name, error in errors.items()}
    better = [
        name for name, result in compared.items() if result.chance * _trials(name, tried) < _level(name)
    ]
    least = min(better or compared, key=lambda name: compared[name].after)
    if not better:
        return None, least, compared[least]
    # Of those that are as good as the best, the first: it knows most, and few records tell little of it.
    best = next(name for name in better if compare(errors[name], errors[least]).chance >= _AS_GOOD)
    return dict(tried)[best], best, compared[best]


def _level(name: str) -> float:
    return BACK_LEVEL if name.startswith(BACK) else LEVEL


def _trials(name: str, tried: Iterable[tuple[str, object]]) -> int:
    """Return by how much the chance of one comparison counts: all of its kind, on each number of records."""
    return len(TESTED) * sum(other.startswith(BACK) == name.startswith(BACK) for other, _ in tried)
