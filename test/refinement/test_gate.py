"""The gate compares a predicted gain with the error of the models."""

import dataclasses
import functools
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from experience_rows import dead_zone_drives
from refinement_fakes import USED, FakeModel, turning_time

from ator_ros.actions.base import Goal
from ator_ros.domains.domain import find_domain
from ator_ros.geometry import Pose
from ator_ros.learning.judging import constant_tree
from ator_ros.performance.error_process import fit_error_process
from ator_ros.performance.features import GENERAL, PAPER_3
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.prior import prior_slopes
from ator_ros.performance.training import features_of, train
from ator_ros.refinement.gate import NO_GATE, Gate, MeasuredGain
from ator_ros.refinement.objective import Objective
from ator_ros.refinement.refiner import Refinement, Refiner
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.world.state import RobotState, World

TOUR = find_domain("tour")
ROBOT = TOUR.robot()
VISIT = TOUR.library(ROBOT)["visit"]
TOO_LOW = MeasuredGain(20, 5, 0.7, 0.1, 0.0, 0.2)


@functools.cache
def learned(count: int = 100) -> PerformanceModel:
    return train("drive_to", dead_zone_drives(count, seed=1), ROBOT)


def linear() -> PerformanceModel:
    """Return one linear rule of the same drives; its errors are those on others."""
    rows, others = (dead_zone_drives(100, seed=seed) for seed in (1, 2))
    known, other = (
        features_of(each, ROBOT, PAPER_3, None).assign(one=1.0) for each in (rows, others)
    )
    terms, names = np.linalg.lstsq(known, rows["duration"])[0], tuple(known)[:-1]
    leaf = constant_tree(known[[names[0]]], np.full(100, terms[-1]))
    tree = dataclasses.replace(
        leaf, names=names, coefficients=terms[None, :-1], upper=np.array([100.0])
    )
    errors = fit_error_process(
        prior_slopes(PAPER_3, ROBOT, None),
        other[[*names]].to_numpy(),
        (others["duration"] - other @ terms).to_numpy(),
    )
    return PerformanceModel("drive_to", ROBOT, {"duration": tree}, GENERAL, errors=errors)


def refined(model: PerformanceModel, gate: Gate, objective: Objective | None = None) -> Refinement:
    """Refine three drives with turns of 60 degrees between them, from the headings of the paths."""
    place, calls = Pose(0.0, 0.0, 0.0), []
    for opened in ({"yaw"}, {"yaw"}, ()):
        place = place.compose(Pose(2.0, 0.0, 0.0))
        calls.append(TopCall(VISIT, Goal(place), frozenset(opened)))
        place = place.compose(Pose(0.0, 0.0, math.radians(60.0)))
    world = World(0.0, RobotState(Pose(0.0, 0.0, 0.0)), {})
    chain = TopChain(tuple(calls))
    return Refiner(ROBOT, {"drive_to": model}, gate).refine(world, chain, objective)


@pytest.mark.parametrize(("make", "words"), [(learned, "refined"), (linear, "no gain predicted")])
def test_only_a_model_of_the_right_form_changes_the_chain(make: Any, words: str) -> None:
    model = make()
    without, behind = refined(model, NO_GATE), refined(model, Gate())
    assert without.refined
    assert without.gain == behind.gain > 0.1
    assert behind.chain is (behind.best if words == "refined" else behind.original)
    assert behind.reason.endswith(words)


def test_few_drives_make_a_gain_less_certain_than_many() -> None:
    assert (
        refined(learned(25), NO_GATE).uncertainty > 2.0 * refined(learned(400), NO_GATE).uncertainty
    )


@pytest.mark.parametrize(
    ("gain", "uncertainty", "reason"),
    [
        (0.7, 0.5, "gain 0.70 s ± 0.50 s: refined"),
        (0.5, 0.7, "gain 0.50 s ± 0.70 s: kept naive"),
        (
            0.04,
            0.01,
            "gain 0.04 s ± 0.01 s: kept naive, as it is not above one control tick (0.05 s)",
        ),
        (-0.02, 0.1, "no gain predicted"),
    ],
)
def test_the_reason_gives_gain_and_uncertainty(
    gain: float, uncertainty: float, reason: str
) -> None:
    assert Gate().decide(gain, uncertainty) == (reason.endswith("refined"), reason)
    assert NO_GATE.decide(gain, uncertainty)[0] is (gain > 0.0)
    assert NO_GATE.decide(gain, math.inf)[0] is (gain > 0.0)  # a model without errors


@pytest.mark.parametrize(
    ("measured", "drawn", "changed", "compared"),
    [
        (MeasuredGain(), False, True, False),
        (MeasuredGain(), True, False, True),
        (TOO_LOW, False, False, False),
        (TOO_LOW, True, True, False),
        # asked for longer chains
        (dataclasses.replace(TOO_LOW, predicted=-0.7), False, True, False),
    ],
)
def test_a_drawn_chain_runs_the_other_way(
    measured: MeasuredGain, drawn: bool, changed: bool, compared: bool
) -> None:
    answer = refined(learned(), Gate(measured=measured, drawn=drawn))
    assert (answer.refined, answer.comparison) == (changed, compared)
    assert answer.saved > answer.uncertainty


@pytest.mark.parametrize("make", [learned, linear])
@pytest.mark.parametrize("weight", [1e-6, 0.01, 100.0, 1e6])
def test_the_decision_does_not_depend_on_the_scale_of_the_weights(make: Any, weight: float) -> None:
    usual = refined(make(), Gate(), Objective({"duration": 1.0}))
    scaled = refined(make(), Gate(), Objective({"duration": weight}))
    assert (scaled.refined, scaled.reason) == (usual.refined, usual.reason)
    assert scaled.best == usual.best


class Accurate(FakeModel):
    """Its errors at the end depend on the heading there."""

    def predict(
        self, direct: Mapping[str, Any], measures: tuple[str, ...] = (), signs: Any = None
    ) -> Any:
        found = super().predict(direct, measures, signs)
        found.accuracy = 0.1 + 0.02 * np.cos(direct["yawg"]) + 0.0 * found.duration
        return found


def accurate() -> Any:
    return Accurate(turning_time, USED)


@pytest.mark.parametrize("weight", [0.01, 100.0])
def test_without_durations_the_uncertainty_is_said_to_be_unknown(weight: float) -> None:
    answer = refined(accurate(), Gate(), Objective({"accuracy": weight}))
    assert answer.refined
    assert "% of the cost, of unknown uncertainty: refined" in answer.reason
    assert answer.reason == refined(accurate(), Gate(), Objective({"accuracy": 1.0})).reason


@pytest.mark.parametrize(
    "weights", [{"duration": 1e-6, "accuracy": 1.0}, {"duration": 1.0, "accuracy": 1e6}]
)
def test_a_gain_is_a_share_of_the_cost_where_durations_do_not_dominate_it(
    weights: Mapping[str, float],
) -> None:
    answer = refined(accurate(), Gate(), Objective(weights))
    assert answer.refined
    share = 100.0 * answer.gain / answer.before.cost
    assert answer.reason == f"gain {share:.1f} % of the cost, of unknown uncertainty: refined"


def test_with_durations_only_their_uncertainty_is_known() -> None:
    objective = Objective({"duration": 1.0, "accuracy": 1.0})
    answer = refined(accurate(), Gate(), objective)
    assert answer.refined
    assert answer.reason.endswith("s: refined; the uncertainty of accuracy is unknown")


@pytest.mark.parametrize(
    ("gain", "reason"),
    [
        (0.12, "gain 12.0 % of the cost, of unknown uncertainty: refined"),
        (
            0.008,
            "gain 0.8 % of the cost, of unknown uncertainty: kept naive, as it is not above 1 %",
        ),
        (0.0001, "no gain predicted"),
    ],
)
def test_a_share_of_the_cost_has_no_uncertainty(gain: float, reason: str) -> None:
    assert Gate().decide(gain, None) == (reason.endswith("refined"), reason)


@pytest.mark.parametrize("gain", [0.0499, 0.0501, 0.2, 3.0])
@pytest.mark.parametrize("uncertainty", [0.0, 0.1, 1.0])
@pytest.mark.parametrize("factor", [0.5, 1.0, 2.0])
def test_a_gain_must_exceed_a_tick_and_its_uncertainty(
    gain: float, uncertainty: float, factor: float
) -> None:
    gate = Gate(factor=factor)
    pays = gain > 0.05 and gain > factor * uncertainty
    assert gate.pays(gain, uncertainty) is pays
    refine, reason = gate.decide(gain, uncertainty, "kept as sent")
    assert refine is pays
    assert (": refined" in reason) is pays
    assert (": kept as sent" in reason) is not pays
    assert ("not above one control tick" in reason) is (0.05 >= gain > factor * uncertainty)


def test_bounds_of_gains_are_exclusive() -> None:
    assert not Gate().pays(0.05, 0.0)
    assert not Gate().pays(0.3, 0.3)
    assert not Gate().pays(0.01, None)
    assert Gate().pays(0.011, None)
    assert NO_GATE.pays(1e-9, 5.0)
    assert not NO_GATE.pays(0.0, 5.0)
    assert Gate().decide(0.0049, 0.001) == (False, "no gain predicted")
    assert Gate().decide(0.0051, 0.001)[1].startswith("gain 0.01 s")
    assert Gate().decide(0.00049, None) == (False, "no gain predicted")
    assert Gate().decide(0.00051, None)[1].startswith("gain 0.1 % of the cost")
    assert Gate().decide(math.nan, 0.1) == (False, "no gain predicted")


@pytest.mark.parametrize(
    ("changes", "closes"),
    [
        ({}, True),
        ({"refined": 10, "compared": 3}, True),
        ({"refined": 9}, False),
        ({"compared": 2}, False),
        ({"high": 0.34}, True),
        ({"high": 0.36}, False),
        ({"predicted": 0.0, "high": -1.0}, False),
    ],
)
def test_a_measured_gain_of_less_than_half_closes_the_gate(
    changes: dict[str, Any], closes: bool
) -> None:
    measured = dataclasses.replace(TOO_LOW, **changes)
    assert measured.too_low is closes
    assert ("too low: the gate is closed" in str(measured)) is closes
    refine, reason = Gate(measured=measured).decide(0.7, 0.1)
    assert refine is not closes
    assert ("as the measured gain is 0.10 s (0.00 to" in reason) is closes
    drawn, reason = Gate(measured=measured, drawn=True).decide(0.7, 0.1)
    assert drawn is closes
    assert reason.endswith(", to measure what refinement gains")


def test_an_unknown_gain_names_what_it_needs() -> None:
    assert str(MeasuredGain(1, 0)) == (
        "unknown: 1 refined chains and 0 naive ones; two of each needed"
    )
    assert str(dataclasses.replace(TOO_LOW, high=0.6)) == (
        "0.10 s (0.00 to 0.60), predicted 0.70 s, from 20 refined chains and 5 naive ones"
    )
