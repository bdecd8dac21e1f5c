"""Declarations of action servers: how goals are filled, and which results mean success."""

import math
import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from ator_ros.actions.remote import (
    Expectation,
    Filling,
    RemoteCall,
    Success,
    Timeouts,
    failure_in,
    parts,
    status_name,
    value_at,
)
from ator_ros.schema import SchemaError

POSE = Filling("pose", source="goal")
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6


def call(**changes: Any) -> RemoteCall:
    fields: dict[str, Any] = {"server": "go", "type": "a_package/action/Go", "goal": (POSE,)}
    return RemoteCall(**{**fields, **changes})


# ---- goals ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("source", "variable"),
    [
        ("goal", None),
        ("frame", None),
        ("goal.x", "x"),
        ("goal.speed", "speed"),
        ("goal.lift", "lift"),
        (None, None),
    ],
)
def test_a_goal_variable_fills_a_field(source: str | None, variable: str | None) -> None:
    constant = None if source else 1.0
    assert Filling("a.b", source=source, constant=constant).goal_variable == variable


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({}, "source, constant: expected one of the two"),
        ({"source": "goal", "constant": 1}, "source, constant: expected one of the two"),
        ({"source": "robot.x"}, "source: expected one of goal, goal.x, .*or goal.NAME"),
        ({"source": "goal."}, "source: expected one of"),
        ({"source": "goal.a b"}, "source: expected one of"),
        ({"source": "goal.x", "frame": "map"}, "frame: expected none without `source: goal`"),
        ({"constant": 1, "frame": "map"}, "frame: expected none without `source: goal`"),
    ],
)
def test_a_field_is_filled_in_one_way(fields: dict[str, Any], expected: str) -> None:
    with pytest.raises(SchemaError, match=expected):
        Filling("a", **fields)


def test_the_frame_of_a_pose_may_be_given_and_a_constant_may_be_false() -> None:
    assert Filling("pose", source="goal", frame="map").frame == "map"
    assert Filling("a", constant=False).constant is False


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"type": "a_package/Go"}, "type: expected a type as in"),
        ({"type": "a_package/msg/Go"}, "type: expected a type as in"),
        ({"type": "x/a_package/action/Go"}, "type: expected a type as in"),
        ({"goal": ()}, "goal: expected at least one field"),
        ({"goal": (POSE, POSE)}, "goal: expected each field once"),
        ({"cancel_too": ("go",)}, "cancel_too: expected each name once, without go"),
        ({"cancel_too": ("a", "a")}, "cancel_too: expected each name once"),
    ],
)
def test_an_ambiguous_call_is_rejected(changes: dict[str, Any], expected: str) -> None:
    with pytest.raises(SchemaError, match=expected):
        call(**changes)
    with pytest.raises(SchemaError, match="status: expected at least one state"):
        Success(status=())


def test_a_call_may_cancel_others_and_waits_longest_for_the_result() -> None:
    assert call(cancel_too=("a", "b")).cancel_too == ("a", "b")
    timeouts = Timeouts()
    assert timeouts.result == max(
        timeouts.server, timeouts.acceptance, timeouts.silence, timeouts.result, timeouts.cancel
    )
    assert timeouts.cancel <= timeouts.acceptance <= timeouts.silence


def test_paths_lead_to_fields_and_to_the_only_item_of_a_sequence() -> None:
    assert parts("a.b[0].c") == [("a", False), ("b", True), ("c", False)]
    message = SimpleNamespace(a=SimpleNamespace(b=[SimpleNamespace(c=3)]), d=[])
    assert value_at(message, "a.b[0].c") == 3
    assert value_at(message, "a.b") == message.a.b
    assert value_at(message, "d[0]") is None
    assert value_at(message, "d[0].c") is None


POSES = call(server="through", goal=(Filling("poses", source="goals"),))


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"through": POSES, "early": True}, "through: expected none beside `early`"),
        ({"through": call()}, "through.goal: expected a field with `source: goals`"),
        ({"through": call(goal=POSES.goal, through=POSES)}, "through: expected no `through` in it"),
    ],
)
def test_goals_are_passed_in_one_way(fields: dict[str, Any], expected: str) -> None:
    assert [each.passes for each in (call(), call(early=True), call(through=POSES))] == [
        False, True, True,
    ]  # fmt: skip
    with pytest.raises(SchemaError, match=expected):
        call(**fields)


# ---- results -------------------------------------------------------------------------------------


def test_states_have_the_names_of_action_msgs() -> None:
    names = ["unknown", "accepted", "executing", "canceling", "succeeded", "canceled", "aborted"]
    assert [status_name(number) for number in range(7)] == names
    assert (status_name(7), status_name(-1)) == ("7", "-1")


def test_the_final_state_decides_where_nothing_else_is_declared() -> None:
    result = SimpleNamespace(done=False)
    assert failure_in(call(), SUCCEEDED, result) is None
    assert failure_in(call(), ABORTED, result) == "its goal is aborted"
    both = call(success=Success(status=("succeeded", "canceled")))
    assert failure_in(both, CANCELED, result) is None
    assert failure_in(both, ABORTED, result) == "its goal is aborted"


@pytest.mark.parametrize(
    ("expected", "value", "equal"),
    [
        (True, True, True),
        (True, False, False),
        (3, 3, True),
        (3, 4, False),
        ("there", "there", True),
        ("there", "", False),
        (0.1, 0.10000000149011612, True),  # as a 32-bit float
        (0.1, 0.10001, False),
        (1.0, 1.0000015, False),
        (1.0, 1.0000009, True),
        (0.0, 1e-10, True),
        (0.0, 1.5e-9, False),
        (2.0, 2, True),
        (2.0, "2.0", False),
        (math.inf, math.inf, True),
    ],
)
def test_a_field_has_the_declared_value(expected: Any, value: Any, equal: bool) -> None:
    declared = call(success=Success(fields=(Expectation("outcome", expected),)))
    failure = failure_in(declared, SUCCEEDED, SimpleNamespace(outcome=value))
    assert (failure is None) is equal
    assert equal or str(failure).startswith("outcome: expected ")


def test_all_reasons_are_named_and_those_of_the_server_are_quoted() -> None:
    fields = (Expectation("done", True), Expectation("count", 2))
    declared = call(success=Success(fields=fields, reason="text"))
    result = SimpleNamespace(done=False, count=2, text="door closed", error_msg="not this")
    assert failure_in(declared, ABORTED, result) == (
        "its goal is aborted; done: expected True, got False (door closed)"
    )
    silent = SimpleNamespace(done=False, count=2, text=None)
    assert str(failure_in(declared, SUCCEEDED, silent)).endswith("got False")
    usual = call(success=Success(fields=fields))
    assert str(failure_in(usual, SUCCEEDED, result)).endswith("got False (not this)")
    assert (
        len(str(failure_in(usual, ABORTED, SimpleNamespace(done=1, count=1, error_msg="x" * 999))))
        < 400
    )


class Result:
    """A result as rosidl makes it: constants are attributes of its type."""

    NONE = 0
    BLOCKED = 7
    lower_case = 7

    def __init__(self, error_code: int = 0, error_msg: str = "", code: int = 0) -> None:
        self.error_code = error_code
        self.error_msg = error_msg
        self.code = code


@pytest.fixture
def package(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Put the result into a package of actions, as `a_package.action`."""
    module = ModuleType("a_package.action")
    monkeypatch.setitem(sys.modules, "a_package.action", module)
    monkeypatch.setattr(Result, "__module__", "a_package.action._go")
    module.Go = SimpleNamespace(Result=Result)  # type: ignore[attr-defined]
    other = type("Result", (), {"LOST": 9, "TWICE": 11})
    module.Plan = SimpleNamespace(Result=other)  # type: ignore[attr-defined]
    copy = type("Result", (), {"ALSO": 11})
    module.Copy = SimpleNamespace(Result=copy)  # type: ignore[attr-defined]
    return module


@pytest.mark.parametrize(
    ("code", "named"),
    [
        (7, "error_code: BLOCKED (7)"),
        (9, "error_code: LOST of Plan (9)"),  # codes of other actions are forwarded
        (11, "error_code: 11"),  # two actions have such a code
        (8, "error_code: 8"),
    ],
)
def test_error_codes_have_the_names_of_constants(
    package: ModuleType, code: int, named: str
) -> None:
    reason = failure_in(call(), ABORTED, Result(code, "no path"))
    assert reason == f"its goal is aborted; {named} (no path)"


def test_an_error_code_after_a_success_is_no_failure(package: ModuleType) -> None:
    assert failure_in(call(), SUCCEEDED, Result(7)) is None
    assert failure_in(call(), ABORTED, Result(0)) == "its goal is aborted"


def test_a_declared_code_is_named_once(package: ModuleType) -> None:
    declared = call(success=Success(fields=(Expectation("error_code", 0),)))
    assert failure_in(declared, SUCCEEDED, Result(7)) == "error_code: BLOCKED (7)"
    nested = call(success=Success(fields=(Expectation("outcome.code", 0),)))
    result = SimpleNamespace(outcome=Result(code=7))
    assert failure_in(nested, SUCCEEDED, result) == "outcome.code: BLOCKED (7)"


@pytest.mark.parametrize("value", [True, 7.0, "7"])
def test_only_integers_are_codes(package: ModuleType, value: Any) -> None:
    declared = call(success=Success(fields=(Expectation("code", 0),)))
    result = Result()
    result.code = value
    assert "BLOCKED" not in str(failure_in(declared, SUCCEEDED, result))
