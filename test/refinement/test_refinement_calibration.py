"""The calibration: corrections, no effect on decisions, its file, and learning."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from refinement_fakes import ANGLE, BOTH, ROBOT, models, two_steps, world

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.evaluation.calibration_learning import (
    StepExample,
    cross_validated,
    fit_calibration,
)
from ator_ros.evaluation.trials import EvaluationError
from ator_ros.execution.predictions import Predictor
from ator_ros.files import FileError
from ator_ros.performance.model_file import load_models
from ator_ros.refinement.calibration import (
    CALIBRATION,
    TERMS,
    Calibration,
    PredictedStep,
    Shortfall,
    chain_steps,
    load_calibration,
    load_calibration_if_any,
    model_digest,
    save_calibration,
)
from ator_ros.refinement.chain_prediction import predict_chain
from ator_ros.refinement.gate import OpenGate, ThresholdGate
from ator_ros.refinement.refiner import Refiner
from ator_ros.resources import resource_path

LEARNED = load_models(ROBOT, SOCCER.known_features)
ADDED = {"goToPose": 0.25, "dribbleBall": 0.5}


def constant(action: str, seconds: float) -> Shortfall:
    return Shortfall(seconds, {}, -1.0, 1.0, model_digest(LEARNED[action]))


ALWAYS = Calibration({action: constant(action, seconds) for action, seconds in ADDED.items()})


def step(predicted: float = 3.0, ideal: float = 3.0, v: float = 0.0, speedg: float = 0.0) -> PredictedStep:
    return PredictedStep(v, speedg, predicted, 0.1, ideal, 2.0)


def test_a_chosen_heading_has_its_own_correction() -> None:
    slopes = {"heading_open": 0.05, "below_ideal_heading_open": 0.5}
    chosen = step(ideal=3.4)._replace(heading_open=True)
    assert Shortfall(0.1, slopes, 0.0, 1.0, "").of(step(ideal=3.4)) == pytest.approx(0.1)
    assert Shortfall(0.1, slopes, 0.0, 1.0, "").of(chosen) == pytest.approx(0.1 + 0.05 + 0.5 * 0.4)
    chain = two_steps(ANGLE)
    prediction = predict_chain(world(), chain, LEARNED, ROBOT)
    steps = chain_steps(prediction, chain, world(), LEARNED, ROBOT)
    assert [made is not None and made.heading_open for made in steps] == [True, False]


@pytest.mark.parametrize("opened", [ANGLE, BOTH])
@pytest.mark.parametrize("gate", [OpenGate(), ThresholdGate(100.0)])
def test_it_is_reported_and_decides_nothing(opened: frozenset[str], gate: Any) -> None:
    chain = two_steps(opened)
    plain = Refiner(ROBOT, LEARNED, gate).refine(world(), chain)
    corrected = Refiner(ROBOT, LEARNED, gate, calibration=ALWAYS).refine(world(), chain)
    assert plain.free
    for field in ("chain", "best", "original", "refined", "reason", "features"):
        assert getattr(corrected, field) == getattr(plain, field)
    for name in ("before", "after"):
        raw, calibrated = getattr(plain, name), getattr(corrected, name)
        shifts = [b["duration"] - a["duration"] for a, b in zip(raw.actions, calibrated.actions, strict=True)]
        assert shifts == pytest.approx(list(ADDED.values()))
        assert calibrated.duration == pytest.approx(raw.duration + 0.75)
        assert calibrated.cost == pytest.approx(raw.cost + 0.75)
        assert calibrated.spread == raw.spread


def test_a_gate_may_decide_from_it() -> None:
    """With a shortfall that grows with the arrival speed, a stop at the subgoal is better."""
    chain = two_steps(BOTH)
    speed = dataclasses.replace(constant("goToPose", 0.0), slopes={"speedg": 20.0}, high=20.0)
    calibration = Calibration({"goToPose": speed})
    plain, corrected = (
        Refiner(ROBOT, LEARNED, OpenGate(corrected=it), calibration=calibration).refine(world(), chain)
        for it in (False, True)
    )
    assert plain.best == corrected.best != chain
    assert (plain.refined, corrected.refined) == (True, False)
    assert plain.before == corrected.before
    assert plain.after == corrected.after
    assert corrected.before is not None
    assert corrected.after is not None
    assert corrected.features["gain"] == corrected.before.cost - corrected.after.cost < 0.0
    assert plain.features["gain"] > 0.0


def test_the_executor_predicts_the_same_as_refinement() -> None:
    calibration = load_calibration_if_any(resource_path("models"))
    refinement = Refiner(ROBOT, LEARNED, calibration=calibration).refine(world(), two_steps(BOTH))
    raw = predict_chain(world(), refinement.best, LEARNED, ROBOT)
    executed = Predictor(ROBOT, LEARNED, calibration).chain(world(), refinement.best)
    assert executed is not None
    assert refinement.after is not None
    assert executed.duration == pytest.approx(refinement.after.duration, abs=1e-9)
    assert executed.duration != raw.duration


def test_predictions_of_other_models_are_unchanged() -> None:
    foreign = Calibration({"goToPose": dataclasses.replace(constant("goToPose", 0.25), model="0" * 16)})
    plain = Refiner(ROBOT, LEARNED).refine(world(), two_steps())
    assert Refiner(ROBOT, LEARNED, calibration=foreign).refine(world(), two_steps()).after == plain.after
    fakes = models()  # without ideal times and digest
    assert Refiner(ROBOT, fakes, calibration=ALWAYS).refine(world(), two_steps()).after == (
        Refiner(ROBOT, fakes).refine(world(), two_steps()).after
    )


def test_the_shipped_calibration_belongs_to_the_shipped_models() -> None:
    calibration = load_calibration(resource_path("models") / CALIBRATION)
    assert set(calibration.shortfalls) == set(LEARNED)
    assert calibration.matching(LEARNED) == calibration
    training = json.loads((resource_path("models") / CALIBRATION).read_text())["training"]
    assert "3111" not in {str(row["seed"]) for row in training["chains"]}  # the seed of its evaluation
    for row in training["cross_validation"].values():
        assert abs(row["corrected_s"]) < abs(row["raw_s"])
        assert abs(row["corrected_s"]) <= 0.05


def test_a_file_restores_the_calibration(tmp_path: Path) -> None:
    path = tmp_path / CALIBRATION
    assert load_calibration_if_any(tmp_path) == Calibration()
    shortfall = Shortfall(0.1, {"v": 1.0 / 3.0}, -0.1, 0.5, "ab")
    save_calibration(path, Calibration({"goToPose": shortfall}), {"seed": 301})
    assert load_calibration_if_any(tmp_path) == Calibration({"goToPose": shortfall})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"shortfalls": {"../x": {"constant": 0, "slopes": {}, "low": 0, "high": 0, "model": ""}}},
            "expected a name of letters",
        ),
        ({"shortfalls": {"goToPose": {"slopes": {"w": 1.0}}}}, "slopes.w: expected one of .*; got 'w'"),
        ({"shortfalls": {"goToPose": {"slopes": {"v": 1e9}}}}, "slopes.v: expected a number from"),
        (
            {"shortfalls": {"goToPose": {"slopes": {}, "constant": 0, "low": 1, "high": 0, "model": ""}}},
            "expected low at most high",
        ),
    ],
)
def test_foreign_and_damaged_files_are_rejected(change: dict[str, Any], message: str, tmp_path: Path) -> None:
    path = tmp_path / CALIBRATION
    save_calibration(path, Calibration(), {})
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(FileError, match=message):
        load_calibration(path)


def examples(count: int, noise: float) -> list[StepExample]:
    """Return steps longer by 0.1 s plus 0.6 times the ideal time's excess over the prediction."""
    rng = np.random.default_rng(5)
    rows = []
    for number in range(count):
        predicted, gap, v = rng.uniform(2.0, 6.0), rng.uniform(-0.3, 0.5), rng.uniform(0.0, 0.8)
        made = step(float(predicted), float(predicted + gap), v=float(v))
        actual = predicted + 0.1 + 0.6 * max(gap, 0.0) + noise * rng.standard_normal()
        rows.append(
            StepExample("dribble refined", (301 + number % 2, number // 2), "goToPose", made, float(actual))
        )
    return rows


def test_the_shortfall_is_learned() -> None:
    shortfall = fit_calibration(examples(200, 0.05), LEARNED).shortfalls["goToPose"]
    assert shortfall.model == model_digest(LEARNED["goToPose"])
    assert set(shortfall.slopes) < set(TERMS)  # constant terms cannot be learned
    assert shortfall.of(step(4.0, 4.0, v=0.4)) == pytest.approx(0.1, abs=0.03)
    assert shortfall.of(step(4.0, 4.4, v=0.4)) == pytest.approx(0.34, abs=0.03)


def test_the_learned_shortfall_holds_for_other_situations() -> None:
    row = cross_validated(examples(200, 0.05), LEARNED)["dribble refined"]
    assert row["chains"] == 200
    assert row["raw_s"] < -0.15
    low, high = row["corrected_ci95"]
    assert low < 0.0 < high
    assert row["corrected_mae_s"] < 0.5 * row["raw_mae_s"]


def test_too_few_situations_are_rejected() -> None:
    with pytest.raises(EvaluationError, match="at least 20 situations"):
        fit_calibration(examples(19, 0.1), LEARNED)


def test_learning_one_action_keeps_the_others() -> None:
    kept = {name: Shortfall(0.1, {}, 0.1, 0.1, "here") for name in ("drive", "goToPose")}
    learned = fit_calibration(examples(200, 0.05), LEARNED, actions=["goToPose"], kept=kept).shortfalls
    assert learned["drive"] == kept["drive"]
    assert learned["goToPose"] == fit_calibration(examples(200, 0.05), LEARNED).shortfalls["goToPose"]
    with pytest.raises(EvaluationError, match="--actions: kick: expected chains of more situations"):
        fit_calibration(examples(200, 0.05), LEARNED, actions=["kick"], kept=kept)
