"""Changes that the executor accepts from a refinement server: only open variables of the plan."""

import dataclasses
import math

import pytest
from refinement_fakes import ALL, ANGLE, BOTH, NOTHING, ROBOT, call, three_steps, two_steps

from ator_ros.actions.goal_variables import with_values
from ator_ros.domains.soccer.thresholds import RANGES
from ator_ros.refinement.free_variables import allowed_changes
from ator_ros.tops.chain import EVERYTHING, InvalidChainError, TopChain

HUGE = 1e308


def changed(plan: TopChain, step: int, **values: float) -> TopChain:
    return plan.with_goal(step, with_values(plan.calls[step].goal, values))


def test_open_variables_may_be_changed() -> None:
    plan = three_steps(BOTH)
    refined = changed(changed(plan, 0, yaw=1.0), 1, yaw=-3.0, speed=0.5)
    assert allowed_changes(plan, refined, ROBOT, RANGES) == [
        {"yaw": 1.0},
        {"yaw": -3.0, "speed": 0.5},
        {},
    ]


def test_openings_from_the_server_are_ignored() -> None:
    plan = two_steps(NOTHING)
    opened = dataclasses.replace(plan.calls[0], open=ALL)
    refined = changed(TopChain((opened, plan.calls[1])), 0, yaw=1.0)
    with pytest.raises(
        InvalidChainError, match=r"yaw of step 1 \(goToBall\): expected 0 as planned, got 1"
    ):
        allowed_changes(plan, refined, ROBOT, RANGES)


@pytest.mark.parametrize(
    ("name", "value"), [("x", -1.0), ("y", 0.01), ("yaw", 3.0), ("speed", 0.1)]
)
@pytest.mark.parametrize("step", [0, 1])
def test_a_commitment_is_kept(name: str, value: float, step: int) -> None:
    plan = TopChain(
        tuple(dataclasses.replace(each, open=ALL - {name}) for each in two_steps().calls)
    )
    with pytest.raises(InvalidChainError, match=f"{name} of step {step + 1} .* as planned"):
        allowed_changes(plan, changed(plan, step, **{name: value}), ROBOT, RANGES)


def test_a_condition_overrides_an_opening() -> None:
    for opened in ({EVERYTHING}, {"x"}):
        plan = two_steps(frozenset(opened))
        with pytest.raises(
            InvalidChainError, match="expected no change, it is bound by the pre-cond"
        ):
            allowed_changes(plan, changed(plan, 0, x=0.05), ROBOT, RANGES)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *[(name, math.nan) for name in ("x", "y", "yaw", "speed")],
        *[(name, HUGE) for name in ("x", "y", "speed")],
        ("speed", -0.1),
        ("speed", ROBOT.limits.v + 0.01),
    ],
)
def test_a_value_outside_the_domain_is_rejected_open_or_not(name: str, value: float) -> None:
    for opened in (ALL, NOTHING):
        plan = TopChain((call("goToPose", 0.0, 0.0, 0.0, opened),))
        with pytest.raises(
            InvalidChainError, match=f"{name} of step 1 .goToPose.: expected .* got"
        ):
            allowed_changes(plan, changed(plan, 0, **{name: value}), ROBOT, RANGES)


def test_angles_are_equal_modulo_turns_and_rounding() -> None:
    plan = two_steps(ANGLE, yaw=math.pi)
    assert allowed_changes(plan, changed(plan, 0, yaw=-math.pi), ROBOT, RANGES) == [{}, {}]
    assert allowed_changes(plan, changed(plan, 0, x=1e-12, speed=1e-12), ROBOT, RANGES) == [{}, {}]


@pytest.mark.parametrize(
    "refined", [TopChain(()), three_steps(), TopChain(two_steps().calls[::-1])]
)
def test_other_steps_are_rejected(refined: TopChain) -> None:
    with pytest.raises(InvalidChainError, match="expected the steps of the question"):
        allowed_changes(two_steps(), refined, ROBOT, RANGES)
