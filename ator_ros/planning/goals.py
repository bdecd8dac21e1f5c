"""Goals of plans: statements about state variables that must hold at the end."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from contextlib import suppress

from ator_ros.printable import ReadableError, quoted
from ator_ros.tops.conditions import Region, Statement

MOST_STATEMENTS = 8
"""Greatest number of statements of a goal."""


class PlanningError(ReadableError, ValueError):
    """A goal that is invalid or has no plan."""


@dataclasses.dataclass(frozen=True, slots=True)
class Unspecified:
    """A statement without a tolerance: the smallest tolerance that a TOP achieves applies."""

    variable: str
    target: str | float


GoalStatement = Statement | Unspecified


def check_goal(goal: Sequence[GoalStatement], known: Sequence[str]) -> None:
    """Check that a goal has 1 to 8 statements about known variables, each once.

    `known` are the names of the state variables. Raises PlanningError otherwise.
    """
    if not 1 <= len(goal) <= MOST_STATEMENTS:
        raise PlanningError(f"goal: expected 1 to {MOST_STATEMENTS} statements, got {len(goal)}")
    for statement in goal:
        for name in (statement.variable, statement.target):
            if isinstance(name, str) and name not in known:
                raise PlanningError(f"goal: expected one of {', '.join(known)}, got {quoted(name)}")
    names = [statement.variable for statement in goal]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise PlanningError(f"goal: expected each variable once, got {', '.join(twice)} twice")


def statement_from(text: str) -> GoalStatement:
    """Read a statement from VARIABLE=VALUE or VARIABLE=VALUE:LOW:HIGH.

    VALUE is a number in SI units or a variable; LOW and HIGH are offsets from it. Raises
    PlanningError for other texts.
    """
    variable, _, rest = text.partition("=")
    target, *bounds = rest.split(":")
    try:
        numbers = [float(bound) for bound in bounds]
    except ValueError:
        numbers = [math.nan]
    sound_bounds = len(numbers) in (0, 2) and all(map(math.isfinite, numbers))
    if not variable or not target or not sound_bounds:
        raise PlanningError(
            f"goal: expected VARIABLE=VALUE or VARIABLE=VALUE:LOW:HIGH, got {quoted(text)}"
        )
    about: float | str = target
    with suppress(ValueError):
        about = float(target)
    if isinstance(about, float) and not math.isfinite(about):
        raise PlanningError(f"goal: expected a finite number or a variable, got {quoted(target)}")
    if not numbers:
        return Unspecified(variable, about)
    if numbers[0] > numbers[1]:
        raise PlanningError(
            f"goal: {variable}: expected LOW <= HIGH, got {numbers[0]:g} and {numbers[1]:g}"
        )
    return Region(
        variable,
        about,
        numbers[0],
        numbers[1],
    )
