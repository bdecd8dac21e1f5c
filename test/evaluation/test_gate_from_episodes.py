"""The gate of observed models: what one half of the episodes chooses, the other half judges."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from refinement_fakes import LIBRARY, ROBOT

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.evaluation import gate_from_episodes
from ator_ros.evaluation.gate_from_episodes import (
    CrossFit,
    gate_of_episodes,
)
from ator_ros.evaluation.trials import random_trial
from ator_ros.performance.direct import DIRECT_VARIABLES
from ator_ros.performance.training import TrainingError


class Prefers:
    """Predicts `scale` s more, the farther the heading at the goal is from `yaw`."""

    used_variables = frozenset({"yawg"})
    spread = 0.0

    def __init__(self, yaw: float, scale: float) -> None:
        self.yaw, self.scale = yaw, scale

    def predict(self, direct: Mapping[str, Any], measures: tuple[str, ...] = ()) -> Any:
        off = np.abs((np.atleast_1d(direct["yawg"]) - self.yaw + np.pi) % (2.0 * np.pi) - np.pi)
        count = max(np.size(value) for value in direct.values())
        duration = np.broadcast_to(3.0 + self.scale * off, count).copy()
        return SimpleNamespace(duration=duration, spread=np.full(count, self.spread))


def fitted(
    monkeypatch: pytest.MonkeyPatch, models: Mapping[tuple[str, int], Prefers], *, late: float = 0.0
) -> CrossFit:
    """Return a cross-fit whose models of episodes 0, 2, … and 1, 3, … are `models`.

    All episodes took `late` s longer than the first one's model predicts.
    """

    def train(action: str, rows: pd.DataFrame, *_: Any, **__: Any) -> Prefers:
        return models[action, int(rows["episode"].iloc[0]) % 2]

    monkeypatch.setattr(gate_from_episodes, "observed_model", train)
    row = dict.fromkeys(DIRECT_VARIABLES, 0.0) | {"t": 0.0, "success": True, "yawg": 0.5 * np.pi}
    row["duration"] = float(models["goToPose", 0].predict({"yawg": row["yawg"]}).duration[0]) + late
    rows = pd.DataFrame([row | {"episode": number} for number in range(6)])
    tables = {"goToPose": rows, "dribbleBall": rows.assign(duration=3.0 + late)}
    return CrossFit(ROBOT, tables, dict.fromkeys(tables, ()))


def test_the_other_half_judges(monkeypatch: pytest.MonkeyPatch) -> None:
    models = {("goToPose", 0): Prefers(0.0, 0.3), ("goToPose", 1): Prefers(np.pi, 0.3)}
    models |= {("dribbleBall", half): Prefers(0.0, 0.0) for half in (0, 1)}
    trials = [random_trial(SOCCER, "dribble", LIBRARY, seed=403, index=0)]
    cross = fitted(monkeypatch, models)
    examples = cross.examples(trials, seed=0)
    # The chooser's best heading is the worst there is for the judge.
    assert examples.naive.min() > 6.9


def test_so_few_episodes_that_halves_cannot_judge_each_other_are_refused() -> None:
    rows = pd.DataFrame({"episode": np.arange(39), "success": True})
    with pytest.raises(TrainingError, match=r"goToPose: expected at least 40 episodes .* got 39"):
        gate_of_episodes(SOCCER, LIBRARY, {"goToPose": rows}, "dribble", seed=1, situations=1)
