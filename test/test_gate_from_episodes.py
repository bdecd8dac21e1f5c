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
    DRAWS,
    CrossFit,
    gate_of_episodes,
    learn_from_episodes,
    usual_widths,
)
from ator_ros.evaluation.trials import random_trial
from ator_ros.performance.direct import DIRECT_VARIABLES
from ator_ros.performance.training import TrainingError
from ator_ros.refinement.gate import FEATURES
from ator_ros.world.state import CONTROL_PERIOD


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


def test_a_gain_that_only_the_choosing_half_sees_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    models = {("goToPose", half): Prefers(0.0, 0.3) for half in (0, 1)}
    models |= {("dribbleBall", half): Prefers(0.0, 0.0) for half in (0, 1)}
    trials = [random_trial(SOCCER, "dribble", LIBRARY, seed=403, index=index) for index in range(3)]
    examples = fitted(monkeypatch, models).examples(trials, seed=0)
    assert examples.features.shape == (12 * DRAWS, len(FEATURES))
    assert sorted(set(examples.kind)) == [0, 1]
    # What both halves think best is the naive chain itself.
    assert np.allclose(examples.naive, examples.refined, atol=1e-6)


def test_the_other_half_judges(monkeypatch: pytest.MonkeyPatch) -> None:
    models = {("goToPose", 0): Prefers(0.0, 0.3), ("goToPose", 1): Prefers(np.pi, 0.3)}
    models |= {("dribbleBall", half): Prefers(0.0, 0.0) for half in (0, 1)}
    trials = [random_trial(SOCCER, "dribble", LIBRARY, seed=403, index=0)]
    cross = fitted(monkeypatch, models)
    examples = cross.examples(trials, seed=0)
    # The chooser's best heading is the worst there is for the judge.
    assert examples.naive.min() > 6.9


class Dips(Prefers):
    """Predicts 0.8 s less within 2 degrees about `dip`, and otherwise as `Prefers`."""

    def __init__(self, dip: float) -> None:
        super().__init__(0.0, 0.0)
        self.dip = dip

    def predict(self, direct: Mapping[str, Any], measures: tuple[str, ...] = ()) -> Any:
        prediction = super().predict(direct, measures)
        off = np.abs((np.atleast_1d(direct["yaw"]) - self.dip + np.pi) % (2.0 * np.pi) - np.pi)
        prediction.duration = prediction.duration - 0.8 * (off < np.radians(2.0))
        return prediction


def test_examples_are_of_what_is_chosen_with_averaged_costs(monkeypatch: pytest.MonkeyPatch) -> None:
    models: dict[tuple[str, int], Prefers] = {("goToPose", half): Prefers(0.0, 0.2) for half in (0, 1)}
    models |= {("dribbleBall", half): Dips(dip) for half, dip in enumerate((-2.0, 2.0))}
    trials = [random_trial(SOCCER, "dribble", LIBRARY, seed=403, index=index) for index in range(3)]
    cross = fitted(monkeypatch, models)
    loss = [
        float(np.mean(examples.refined - examples.naive))
        for widths in (None, usual_widths(ROBOT))
        for examples in [cross.examples(trials, seed=0, widths=widths)]
    ]
    assert loss[0] > 0.2  # each half follows a dip that the other does not know
    assert abs(loss[1]) < 0.02


class Unsure(Prefers):
    """Predicts twice the spread where the heading at the goal is below 0."""

    def predict(self, direct: Mapping[str, Any], measures: tuple[str, ...] = ()) -> Any:
        prediction = super().predict(direct, measures)
        prediction.spread = (
            np.where(np.atleast_1d(direct["yawg"]) < 0.0, 0.4, 0.2) + 0.0 * prediction.duration
        )
        return prediction


def test_errors_are_drawn_in_units_of_the_predicted_spread(monkeypatch: pytest.MonkeyPatch) -> None:
    models = {(action, half): Unsure(0.0, 0.0) for action in ("goToPose", "dribbleBall") for half in (0, 1)}
    cross = fitted(monkeypatch, models, late=0.1)  # half of the spread there
    trials = [random_trial(SOCCER, "dribble", LIBRARY, seed=403, index=index) for index in range(20)]
    late = {round(float(time) - 6.0, 6) for time in cross.examples(trials, seed=0).naive}
    assert late == {0.2, 0.3, 0.4} or late < {0.2, 0.3, 0.4}
    assert len(late) > 1


def test_many_errors_are_drawn_of_each_chain(monkeypatch: pytest.MonkeyPatch) -> None:
    models = {(action, half): Unsure(0.0, 0.3) for action in ("goToPose", "dribbleBall") for half in (0, 1)}
    cross = fitted(monkeypatch, models)
    cross._errors = dict.fromkeys(("goToPose", "dribbleBall"), np.array([-1.0, 1.0]))
    trials = [random_trial(SOCCER, "dribble", LIBRARY, seed=403, index=index) for index in range(2)]
    examples = cross.examples(trials, seed=0)
    for first in range(0, len(examples.naive), DRAWS):
        of_chain = slice(first, first + DRAWS)
        assert len(np.unique(examples.features[of_chain], axis=0)) == 1
        assert len(np.unique(examples.naive[of_chain].round(9))) > 1
        assert len(np.unique(examples.refined[of_chain].round(9))) > 1


def test_gains_that_do_not_show_in_the_time_of_a_chain_are_not_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """All prefer what is best, and none is uncertain: even the smallest gain is one."""
    models = {(action, half): Prefers(0.0, 0.0) for action in ("goToPose", "dribbleBall") for half in (0, 1)}
    trials = [random_trial(SOCCER, "dribble", LIBRARY, seed=403, index=index) for index in range(20)]
    gate, learned = learn_from_episodes(fitted(monkeypatch, models), trials, seed=0)
    assert learned.threshold.gain < CONTROL_PERIOD
    assert gate.gain == CONTROL_PERIOD


def test_so_few_episodes_that_halves_cannot_judge_each_other_are_refused() -> None:
    rows = pd.DataFrame({"episode": np.arange(39), "success": True})
    with pytest.raises(TrainingError, match=r"goToPose: expected at least 40 episodes .* got 39"):
        gate_of_episodes(SOCCER, LIBRARY, {"goToPose": rows}, "dribble", seed=1, situations=1)
