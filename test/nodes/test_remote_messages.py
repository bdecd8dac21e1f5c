"""Goals and results of action types by field path, without a node."""

import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from action_servers import declared

from ator_interfaces.action import DriveTo, ExecuteChain
from ator_ros.actions.base import Goal
from ator_ros.actions.remote import Expectation, Filling, Success, failure_in
from ator_ros.geometry import Pose
from ator_ros.nodes.remote_messages import RemoteError, RemoteInterface

GOAL = Goal(Pose(1.0, -2.0, 0.0), 0.4)
SUCCEEDED, ABORTED = 4, 6


def written(*fillings: Filling) -> ExecuteChain.Goal:
    return RemoteInterface(declared(goal=fillings), "odom").written((GOAL,))


def test_poses_have_the_frame_of_the_states_unless_declared() -> None:
    for frame, expected in ((None, "odom"), ("map", "map")):
        message = written(Filling("chain.calls[0].goal", source="goal", frame=frame))
        assert message.chain.calls[0].goal.header.frame_id == expected
    message = written(
        Filling("chain.calls[0].goal.pose", source="goal"),
        Filling("chain.calls[0].goal.header.frame_id", source="frame"),
    )
    stamped = message.chain.calls[0].goal
    assert (stamped.pose.position.x, stamped.pose.position.y) == (1.0, -2.0)
    assert stamped.header.frame_id == "odom"


@pytest.mark.parametrize(
    ("filling", "expected"),
    [
        (
            Filling("pose", source="goal"),
            r"goal\[0\].field: expected one of chain, refine, .*got 'pose'",
        ),
        (
            Filling("chain", source="goal"),
            r"goal\[0\]: expected a field of type geometry_msgs/Pose or",
        ),
        (
            Filling("chain.calls.speed", source="goal.speed"),
            r"goal\[0\].field: expected nothing within sequence<ator_interfaces/TopCall, 101>, got "
            r"'speed'",
        ),
        (Filling("refine.x", constant=1), r"goal\[0\].field: expected nothing within boolean"),
        (
            Filling("refine[0]", constant=1),
            r"goal\[0\]: expected a sequence for refine\[0\], got boolean",
        ),
        (
            Filling("fetches", source="goal.speed"),
            r"goal\[0\]: expected a field for a float, got uint8",
        ),
        (Filling("fetches", source="frame"), r"goal\[0\]: expected a field for a text, got uint8"),
        (
            Filling("fetches", constant=256),
            r"goal\[0\]: expected a constant of type uint8, got 256",
        ),
        (Filling("refine", constant=1), r"goal\[0\]: expected a constant of type boolean, got 1"),
        (
            Filling("chain", constant=1),
            r"goal\[0\]: expected a field for a text, a number or a truth value",
        ),
    ],
)
def test_a_goal_that_does_not_match_its_type_is_reported(filling: Filling, expected: str) -> None:
    with pytest.raises(RemoteError, match=f"^{expected}"):
        written(filling)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("no_such_msgs/action/Drive", "apt install ros-jazzy-no-such-msgs.*No module named"),
        ("ator_interfaces/action/Drive", "expected an action of ator_interfaces, got 'Drive'"),
    ],
)
def test_a_missing_type_is_reported(name: str, expected: str) -> None:
    with pytest.raises(RemoteError, match=f"^type: .*{expected}"):
        RemoteInterface(declared(type=name), "odom")


@pytest.mark.parametrize(
    ("success", "expected"),
    [
        (
            Success(fields=(Expectation("code", 0),)),
            r"success.fields\[0\].field: expected one of outcome",
        ),
        (
            Success(fields=(Expectation("outcome.code", "a"),)),
            r"success.fields\[0\]: expected a constant of type uint8",
        ),
        (Success(reason="why"), "success.reason.field: expected one of outcome, record, got 'why'"),
    ],
)
def test_an_invalid_success_declaration_is_reported(success: Success, expected: str) -> None:
    with pytest.raises(RemoteError, match=f"^{expected}"):
        RemoteInterface(declared(success=success), "odom")


def failure(status: int, success: Success, **values: Any) -> str | None:
    result = ExecuteChain.Result()
    for name, value in values.items():
        setattr(result.outcome, name, value)
    return failure_in(declared(success=success), status, result)


def test_success_is_the_status_and_all_fields() -> None:
    both = Success(fields=(Expectation("outcome.code", 1), Expectation("record.refined", False)))
    assert failure(SUCCEEDED, both, code=1) is None
    assert failure(ABORTED, both, code=1) == "its goal is aborted"
    assert failure(SUCCEEDED, both, code=2) == "outcome.code: FAILED (2)"
    assert failure(ABORTED, Success(status=("aborted",))) is None


def test_an_error_code_is_reported_by_its_name_also_if_forwarded(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As of nav2_msgs: the navigator's result holds the code of its planner, and no text."""
    package = ModuleType("some_msgs.action")
    kinds = {
        "Navigate": {"NONE": 0, "UNKNOWN": 9000},
        "Plan": {"NONE": 0, "TIMEOUT": 207, "NO_VALID_PATH": 208},
    }
    for name, constants in kinds.items():
        result = type(
            "Result", (), {**constants, "__module__": f"some_msgs.action._{name.lower()}"}
        )
        setattr(package, name, SimpleNamespace(Result=result))
    monkeypatch.setitem(sys.modules, "some_msgs.action", package)
    call, result = (
        declared(success=Success(fields=(Expectation("error_code", 0),))),
        package.Navigate.Result(),
    )
    for code, text in {208: "NO_VALID_PATH of Plan (208)", 9000: "UNKNOWN (9000)"}.items():
        result.error_code = code
        assert failure_in(call, 6, result) == f"its goal is aborted; error_code: {text}"
    result.error_code = 5
    assert failure_in(call, 4, result) == "error_code: expected 0, got 5"


def test_the_servers_own_reason_is_quoted_without_a_declaration() -> None:
    result = DriveTo.Result(error_code=3, error_msg="Timed out while waiting for action server")
    text = (
        "its goal is aborted; error_code: CANCELED (3) (Timed out while waiting for action server)"
    )
    assert failure_in(declared(success=Success()), ABORTED, result) == text
    assert failure_in(declared(success=Success()), SUCCEEDED, result) is None
    result.error_code = 0
    declaration = Success(fields=(Expectation("error_code", 0),))
    expected = "its goal is aborted (Timed out while waiting for action server)"
    assert failure_in(declared(success=declaration), ABORTED, result) == expected
