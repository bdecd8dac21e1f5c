"""What a plan is for: statements about state variables that shall hold at its end."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence

from ator_ros.planning.errors import PlanningError
from ator_ros.planning.facts import Fact
from ator_ros.planning.values import Symbol, Value, after, difference
from ator_ros.printable import quoted
from ator_ros.tops.chain import Top
from ator_ros.tops.conditions import Region, Statement

MOST_STATEMENTS = 8
_ROBOT = tuple(f"robot.{name}" for name in ("x", "y", "yaw", "v", "w"))
_MOVING = ("robot.", "hold.")
"""The robot's own variables are no destination: they change on the way."""
_HOLD = ("hold.x", "hold.y")


@dataclasses.dataclass(frozen=True, slots=True)
class Unspecified:
    """A statement whose tolerance is left to the TOPs: as near as the best of them brings it."""

    variable: str
    target: str | float


Wish = Statement | Unspecified


def known_variables(objects: Sequence[str], *, holder: bool) -> tuple[str, ...]:
    """Return the state variables that can be wished for."""
    moving = (f"{name}.{axis}" for name in objects for axis in ("x", "y", "vx", "vy"))
    return (*_ROBOT, *(_HOLD if holder else ()), *moving)


def checked(wishes: Sequence[Wish], known: Sequence[str]) -> None:
    """Make sure that wishes are about known variables.

    Raises
    ------
    PlanningError
        There are none or too many, or one names an unknown variable, or one variable comes twice.
    """
    if not 1 <= len(wishes) <= MOST_STATEMENTS:
        raise PlanningError(f"goal: expected 1 to {MOST_STATEMENTS} statements, got {len(wishes)}")
    for wish in wishes:
        for name in (wish.variable, wish.target):
            if isinstance(name, str) and name not in known:
                raise PlanningError(f"goal: expected one of {', '.join(known)}, got {quoted(name)}")
    names = [wish.variable for wish in wishes]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise PlanningError(f"goal: expected each variable once, {', '.join(twice)} come twice")


def facts_of(wishes: Sequence[Wish], tops: Sequence[Top]) -> list[Fact]:
    """Return what shall hold as facts, with the tolerances that `tops` leave where none is given."""
    return [Fact(_specified(wish, tops), surely=True) for wish in wishes]


def _specified(wish: Wish, tops: Sequence[Top]) -> Statement:
    if not isinstance(wish, Unspecified):
        return wish
    left = [value for top in tops if (value := _left(wish, top)) is not None and _is_bounded(value)]
    best = min(left, key=lambda value: value.high - value.low, default=Value(""))
    return Region(wish.variable, wish.target, best.low, best.high)


def _is_bounded(value: Value) -> bool:
    return math.isfinite(value.low) and math.isfinite(value.high)


def _left(wish: Unspecified, top: Top) -> Value | None:
    """Return where a TOP leaves the variable, if it can bring it to the target."""
    for binding in itertools.chain([{}], bindings_for([wish], top)):
        value = after(top, binding).get(wish.variable)
        target = after(top, binding).get(str(wish.target), Value(wish.target))
        if value is not None and difference(wish.variable, value, target) is not None:
            return Value(value.symbol, value.low - target.high, value.high - target.low)
    return None


def groups_of(facts: Sequence[Fact]) -> list[list[Statement]]:
    """Return the statements of `facts` by what they are about: the robot, the hold, an object."""
    groups: dict[str, list[Statement]] = {}
    for fact in facts:
        if isinstance(fact.said, Statement):
            groups.setdefault(fact.said.variable.partition(".")[0], []).append(fact.said)
    return list(groups.values())


def bindings_for(wishes: Sequence[Wish], top: Top) -> Iterator[Mapping[str, Symbol]]:
    """Yield the goal of a TOP that brings about as many of `wishes` as it can; nothing if it can't any."""
    open_goal = {name: f"goal.{name}" for name in _goal_variables(top)}
    values = after(top, open_goal)
    found: dict[str, Symbol] = {}
    for wish in wishes:
        if str(wish.target).startswith(_MOVING):
            continue
        symbol = values[wish.variable].symbol if wish.variable in values else ""
        if isinstance(symbol, str) and symbol in open_goal.values():
            target = wish.target
            found.setdefault(
                symbol.removeprefix("goal."), target if isinstance(target, str) else float(target)
            )
    if found:
        yield found


def _goal_variables(top: Top) -> frozenset[str]:
    named = top.pre.goal_names() | top.post.goal_names()
    return named | {"x", "y", "yaw", "speed"}


def wish_from(text: str) -> Wish:
    """Read a statement: VARIABLE=VALUE or VARIABLE=VALUE:LOW:HIGH; a value is a number or a variable.

    Raises
    ------
    PlanningError
        It is none.
    """
    variable, _, rest = text.partition("=")
    target, *bounds = rest.split(":")
    try:
        numbers = [float(bound) for bound in bounds]
    except ValueError:
        numbers = [math.nan]
    if not variable or not target or len(numbers) not in (0, 2) or not all(map(math.isfinite, numbers)):
        raise PlanningError(f"goal: expected VARIABLE=VALUE or VARIABLE=VALUE:LOW:HIGH, got {quoted(text)}")
    about = _number_or_name(target)
    if not numbers:
        return Unspecified(variable, about)
    if numbers[0] > numbers[1]:
        raise PlanningError(f"goal: {variable}: expected LOW <= HIGH, got {numbers[0]:g} and {numbers[1]:g}")
    return Region(variable, about, numbers[0], numbers[1])


def _number_or_name(text: str) -> float | str:
    try:
        value = float(text)
    except ValueError:
        return text
    if not math.isfinite(value):
        raise PlanningError(f"goal: expected a finite number or a variable, got {quoted(text)}")
    return value
