"""The history of a view: executed chains, the models' error, and what refinement gained."""

from __future__ import annotations

import math

import pytest

from ator_ros.geometry import Pose
from ator_ros.viewing.history import Driven, History, gains, told

START = (Pose(0.0, 0.0, 0.0), Pose(1.0, 0.0, 0.0), Pose(2.0, 1.0, 0.5))
ELSEWHERE = (Pose(0.5, 0.0, 0.0), *START[1:])


def driven(actual: float, *, refined: bool, start: tuple[Pose, ...] = START) -> Driven:
    outcome = "succeeded" if math.isfinite(actual) else "failed"
    return Driven(0.0, ("goToBall", "dribbleBall"), refined, 8.0, actual, outcome, start)


def test_the_gain_is_over_the_last_chain_as_planned_from_the_same_start() -> None:
    chains = (
        driven(9.0, refined=False),
        driven(7.0, refined=True, start=ELSEWHERE),
        driven(10.0, refined=False),
        driven(8.5, refined=True),
        driven(8.0, refined=True, start=(Pose(0.02, 0.0, 0.01), *START[1:])),
    )
    assert gains(chains) == pytest.approx((math.nan, math.nan, math.nan, 1.5, 2.0), nan_ok=True)


def test_the_gain_is_found_however_many_chains_were_driven_elsewhere_in_between() -> None:
    between = [
        driven(7.0, refined=False, start=(Pose(0.01 * number, 1.0, 0.0), *START[1:])) for number in range(200)
    ]
    chains = (driven(9.0, refined=False), *between, driven(8.0, refined=True))
    assert gains(chains)[-1] == pytest.approx(1.0)
    across = (Pose(-0.02, -0.02, 0.0), *START[1:])  # in another square of the floor
    assert gains((driven(9.0, refined=False), driven(8.0, refined=True, start=across)))[1] == pytest.approx(
        1.0
    )
    assert math.isnan(gains((driven(9.0, refined=False, start=()), driven(8.0, refined=True)))[1])


def test_the_comparisons_grow_with_the_number_of_chains_and_not_with_its_square(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    compared = []
    repeats = Driven.repeats
    monkeypatch.setattr(
        Driven, "repeats", lambda self, other: compared.append(1) is None and repeats(self, other)
    )
    numbers = []
    for each in (200, 400):
        compared.clear()
        balls = [(START[0], Pose(0.1 * number, 0.0, 0.0), START[2]) for number in range(each)]
        gains([driven(9.0, refined=refined, start=ball) for refined in (False, True) for ball in balls])
        numbers.append(len(compared))
    assert 0 < numbers[1] <= 2.1 * numbers[0]


def test_it_tells_error_gain_learned_models_and_the_newest_chains_first() -> None:
    history = History()
    assert told(history.chains) == "no chain was executed yet"
    for chain in (driven(9.0, refined=False), driven(8.5, refined=True), driven(math.nan, refined=True)):
        history.add(chain)
    text = told(history.chains, "abc from episodes: 40 of goToPose")
    assert "3 chains, 2 of them refined." in text
    assert "Model error, last 2: 0.75 s, mean -0.75 s" in text
    assert "same start: +0.50 s, mean of 1" in text
    assert "Learned models: abc from episodes: 40 of goToPose." in text
    assert text.splitlines()[-3:] == [
        "| 3 | goToBall, dribbleBall (refined) | 8.00 | failed | - |",
        "| 2 | goToBall, dribbleBall (refined) | 8.00 | 8.50 | 0.50 |",
        "| 1 | goToBall, dribbleBall (as sent) | 8.00 | 9.00 | - |",
    ]


def test_curves_hold_the_chains_whose_times_are_known() -> None:
    history = History()
    assert [len(curve) for curve in history.curves()] == [0, 0, 0]
    for chain in (driven(9.0, refined=False), driven(math.nan, refined=False), driven(7.0, refined=True)):
        history.add(chain)
    assert [curve.tolist() for curve in history.curves()] == [[1.0, 3.0], [8.0, 8.0], [9.0, 7.0]]
    assert history.edition == 3
