"""Declarations of actions that an external action server executes, without ROS."""

from __future__ import annotations

import dataclasses
import math
import re
import sys
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from ator_ros.actions.base import Action, ActionError, Goal, Step
from ator_ros.actions.goal_variables import GOAL_VARIABLES
from ator_ros.files import is_name
from ator_ros.printable import printable, quoted
from ator_ros.schema import Within, require
from ator_ros.world.state import World

Scalar = bool | int | float | str
_SOURCES = ("goal", *(f"goal.{name}" for name in GOAL_VARIABLES), "goals", "frame")
_TYPE = re.compile(r"[a-z]\w*/action/[A-Z]\w*")
LONGEST = 86_400.0
"""Greatest timeout in s: a day, longer than a robot drives on one charge."""
Duration = Annotated[float, Within(0.001, LONGEST)]


@dataclass(frozen=True, slots=True)
class Filling:
    """How one field of the server's goal is filled: either from a source or with a constant.

    Attributes
    ----------
    field : str
        Names joined by dots. [0] makes the only item of a sequence, as in poses[0].pose.
    source : str or None
        "goal" (its pose), "goals" (a list of poses, see `RemoteCall.through`), "goal.NAME" (one of
        its variables, also one that the action declares), or "frame".
    frame : str or None
        With the source "goal" or "goals": the frame of the poses; None: the frame in which the node
        estimates the state.
    """

    field: str
    source: str | None = None
    constant: Scalar | None = None
    frame: str | None = None

    def __post_init__(self) -> None:
        both = [name for name in (self.source, self.constant) if name is not None]
        require(
            len(both) == 1,
            "source, constant",
            "one of the two",
            both,
        )
        named = self.source in (None, *_SOURCES) or self.goal_variable is not None
        require(
            named,
            "source",
            f"one of {', '.join(_SOURCES)}, or goal.NAME",
            self.source,
        )
        framed = self.frame is None or self.source in ("goal", "goals")
        require(
            framed,
            "frame",
            "none without `source: goal` or `goals`",
            self.frame,
        )

    @property
    def goal_variable(self) -> str | None:
        """The name of the goal variable that fills the field; None if another source does."""
        start, _, name = (self.source or "").partition(".")
        return name if start == "goal" and is_name(name) else None


@dataclass(frozen=True, slots=True)
class Expectation:
    """A field of a server's result and the value that means success."""

    field: str
    equals: Scalar


@dataclass(frozen=True, slots=True)
class Success:
    """The final states of a goal, and the fields of its result, that mean success.

    `reason` is a field of the result with the reason of a failure, for messages; None: the field
    error_msg, if the result has it.
    """

    status: tuple[Literal["succeeded", "aborted", "canceled"], ...] = ("succeeded",)
    fields: tuple[Expectation, ...] = ()
    reason: str | None = None

    def __post_init__(self) -> None:
        require(
            bool(self.status),
            "status",
            "at least one state",
            list(self.status),
        )


@dataclass(frozen=True, slots=True)
class Timeouts:
    """Timeouts in s, real time except that of the result, which is by the stamps of the states.

    `silence` is the time without feedback or a reply to a request during the execution of a goal.
    Six requests are sent in that time. It applies to servers that have replied before.
    """

    server: Duration = 2.0  # without a server, before the goal is sent and during its execution
    acceptance: Duration = 2.0  # from the goal until it is accepted or rejected
    silence: Duration = 3.0
    # from the acceptance until the result; in a run of passed goals, for each of them
    result: Duration = 120.0
    cancel: Duration = 1.0  # from a cancellation until the server reports the end of the goal


@dataclass(frozen=True, slots=True)
class RemoteCall:
    """An action server, and the meaning of its goal and result.

    Two declarations mean that goals can be passed, see `ator_ros.actions.goal_variables.STOP`:
    `early`, that it takes a newer goal while it drives, without a stop; or `through`, another
    server that drives through a list of poses. Goals that are passed, and the one that ends such a
    run, are one goal of that server. If that server is `early`, the rest of a run is sent as a
    newer goal where one is passed: it may drive back to a passed pose otherwise.
    """

    server: str  # name, relative to the node's namespace, or absolute
    type: str  # such as nav2_msgs/action/NavigateToPose, which is imported at run time
    goal: tuple[Filling, ...]  # other fields keep their defaults
    success: Success = dataclasses.field(default_factory=Success)
    timeouts: Timeouts = dataclasses.field(default_factory=Timeouts)
    # other action servers, all goals of which are canceled if this server is gone or hangs
    cancel_too: tuple[str, ...] = ()
    early: bool = False
    through: RemoteCall | None = None

    @property
    def servers(self) -> tuple[RemoteCall, ...]:
        """The server itself, and the one that drives through poses, if there is one."""
        return (self,) if self.through is None else (self, self.through)

    @property
    def passes(self) -> bool:
        """Whether goals can be passed."""
        return self.early or self.through is not None

    def __post_init__(self) -> None:
        if self.through is not None:
            sources = [filling.source for filling in self.through.goal]
            require(not self.early, "through", "none beside `early`", self.through.server)
            require("goals" in sources, "through.goal", "a field with `source: goals`", sources)
            nested = self.through.through
            require(nested is None, "through", "no `through` in it", nested and nested.server)
        require(
            bool(_TYPE.fullmatch(self.type)),
            "type",
            "a type as in a_package/action/AType",
            self.type,
        )
        fields = [filling.field for filling in self.goal]
        require(
            bool(fields),
            "goal",
            "at least one field",
            fields,
        )
        require(
            len(set(fields)) == len(fields),
            "goal",
            "each field once",
            fields,
        )
        others = list(self.cancel_too)
        distinct = len({self.server, *others}) == len(others) + 1
        require(
            distinct,
            "cancel_too",
            f"each name once, without {self.server}",
            others,
        )


class UnreachableAction(Action):
    """An action whose server can be used over ROS only: without ROS it never starts."""

    name = "remote"

    def start(
        self,
        world: World,  # noqa: ARG002
        goal: Goal,  # noqa: ARG002
    ) -> None:
        """Raise ActionError."""
        raise ActionError("its action server can be used over ROS only")

    def step(self, world: World) -> Step:
        """Not called, as it never starts."""
        raise NotImplementedError


# Fields of the results of Nav2's actions, and of others that follow them.
_ERROR_CODE = "error_code"
_ERROR_TEXT = "error_msg"
_STATUS = ("unknown", "accepted", "executing", "canceling", "succeeded", "canceled", "aborted")
"""Names of the states of action_msgs/GoalStatus, by number."""


def status_name(status: int) -> str:
    """Return the name of a goal's state; its number if it has none."""
    return _STATUS[status] if 0 <= status < len(_STATUS) else str(status)


def failure_in(
    call: RemoteCall,
    status: int,
    result: Any,
) -> str | None:
    """Return why a result means failure; None if it means success."""
    success = call.success
    wrong = []
    if status_name(status) not in success.status:
        wrong.append(f"its goal is {status_name(status)}")
    for expected in success.fields:
        value = value_at(result, expected.field)
        if _equal(value, expected.equals):
            continue
        name = _constant_name(result, expected.field)
        expects = f"expected {quoted(expected.equals)}, got {quoted(value)}"
        wrong.append(f"{expected.field}: {f'{name} ({value})' if name else expects}")
    if not wrong:
        return None
    declared = {expected.field for expected in success.fields}
    code = getattr(result, _ERROR_CODE, None)
    if code and _ERROR_CODE not in declared:
        name = _constant_name(result, _ERROR_CODE)
        wrong.append(f"{_ERROR_CODE}: {f'{name} ({code})' if name else code}")
    if success.reason is not None:
        reason = str(value_at(result, success.reason) or "")
    else:
        reason = str(getattr(result, _ERROR_TEXT, ""))
    return "; ".join(wrong) + (f" ({printable(reason, 200)})" if reason else "")


def _equal(value: Any, expected: Scalar) -> bool:
    """Return whether a value of a result is the expected one; a float up to its precision."""
    if isinstance(expected, float) and isinstance(value, int | float):
        return math.isclose(
            value,
            expected,
            rel_tol=1e-6,
            abs_tol=1e-9,
        )  # of 32-bit floats
    return bool(value == expected)


def _constant_name(result: Any, path: str) -> str:
    """Return the name of the only constant with the value of an integer in a result, or "".

    Constants of the message that holds the integer come first. Those of other actions of the
    package follow: Nav2's navigators forward the codes of the planner and the controller.
    """
    parent, _, _ = path.rpartition(".")
    value = value_at(result, path)
    if type(value) is not int:
        return ""
    names = _constants(type(value_at(result, parent) if parent else result), value)
    if not names:
        package = sys.modules.get(type(result).__module__.rpartition(".")[0])
        for action, kind in vars(package).items() if package else ():
            found = _constants(getattr(kind, "Result", None), value)
            names += [f"{name} of {action}" for name in found]
    return names[0] if len(names) == 1 else ""


def _constants(kind: Any, value: int) -> list[str]:
    """Return the names of the constants of a message's type that have a value."""
    constants = vars(kind) if kind else {}
    return [
        name
        for name, constant in constants.items()
        if name.isupper() and type(constant) is int and constant == value
    ]


def parts(path: str) -> list[tuple[str, bool]]:
    """Return the names in a path, each with whether it has the index [0]."""
    return [(part.removesuffix("[0]"), part.endswith("[0]")) for part in path.split(".")]


def value_at(message: Any, path: str) -> Any:
    """Return the value at a path; None if a sequence in the path is empty."""
    for name, indexed in parts(path):
        message = getattr(message, name)
        if indexed and not len(message):
            return None
        message = message[0] if indexed else message
    return message
