"""The line that says how a chain went."""

import math

import pytest
from view.in_process import record_of

from ator_interfaces.msg import FreeVariable, Gain, Outcome, Performance, TopCall, TopChain
from ator_interfaces.srv import RefineSubgoal
from ator_ros.nodes.result_line import changes_of, result_line

ANSWER = RefineSubgoal.Response(
    refined=True,
    chain=TopChain(calls=[TopCall(top="goToBall"), TopCall(top="dribbleBall")]),
    free=[
        FreeVariable(subgoal=0, name="yaw", before=0.0283, after=0.2746),
        FreeVariable(subgoal=0, name="speed", before=0.0, after=0.8),
    ],
)


def record(*, refined: bool, code: int = Outcome.SUCCEEDED) -> object:
    made = record_of(code=code, reason="arrived", duration=6.55, refined=refined)
    made.predicted = Performance(duration=6.54)
    made.gain = Gain(predicted=0.22)
    made.refinement = "gain 0.01 s ± 0.03 s: kept naive"
    return made


def test_success_has_durations_and_changes() -> None:
    line = result_line(record(refined=True), wanted=True, changes=changes_of(ANSWER))
    changes = "+14° at step 1 (goToBall), speed 0.8 at step 1 (goToBall)"
    assert line == (
        f"arrived: 6.55 s driven, 6.54 s predicted; refined: {changes}, predicted to save 0.22 s"
    )


@pytest.mark.parametrize(("after", "words"), [(0.0, "no stop"), (1.0, "a stop")])
def test_a_step_that_passes_is_named(after: float, words: str) -> None:
    answer = RefineSubgoal.Response(
        refined=True,
        chain=TopChain(calls=[TopCall(top="visit")]),
        free=[FreeVariable(subgoal=0, name="stop", before=1.0 - after, after=after)],
    )
    assert changes_of(answer) == [f"{words} at step 1 (visit)"]


def test_a_kept_chain_has_the_reason_of_the_gate() -> None:
    kept = result_line(record(refined=False), wanted=True, changes=[])
    assert kept.endswith("6.54 s predicted; gain 0.01 s ± 0.03 s: kept naive")
    assert result_line(record(refined=False), wanted=False, changes=[]).endswith("predicted")


@pytest.mark.parametrize(("bound", "late"), [(6.5, True), (6.6, False), (math.nan, False)])
def test_a_run_that_is_longer_than_nine_of_ten_is_named(bound: float, late: bool) -> None:
    made = record(refined=False)
    made.predicted = Performance(duration=6.0, bound=bound)
    line = result_line(made, wanted=False, changes=[])
    assert ("; nine of ten runs take less than 6.50 s" in line) is late


def test_without_models_nothing_is_predicted() -> None:
    made = record(refined=False)
    made.predicted = Performance(duration=math.nan)
    assert result_line(made, wanted=False, changes=[]) == "arrived: 6.55 s driven"


@pytest.mark.parametrize("code", [Outcome.FAILED, Outcome.CANCELED, Outcome.REFUSED])
def test_other_ends_keep_their_reason(code: int) -> None:
    assert result_line(record(refined=True, code=code), wanted=True, changes=["x"]) == "arrived"


@pytest.mark.parametrize(("length", "text"), [(5, "… and 5 more"), (5000, "6.54 s predicted")])
def test_many_changes_and_long_names_are_cut(length: int, text: str) -> None:
    many = [FreeVariable(name="v" * length, after=float(number + 1)) for number in range(9)]
    changes = changes_of(RefineSubgoal.Response(refined=True, chain=ANSWER.chain, free=many))
    line = result_line(record(refined=True), wanted=True, changes=changes)
    assert text in line
    assert len(line) < 301


@pytest.mark.parametrize("code", [Outcome.SUCCEEDED, Outcome.FAILED])
def test_long_reasons_are_cut(code: int) -> None:
    made = record(refined=False, code=code)
    made.outcome.reason = "why " * 500
    assert len(result_line(made, wanted=True, changes=[])) < 301
