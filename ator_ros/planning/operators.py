"""Operators: the TOPs of a library with the goals that matter for what is wanted."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ator_ros.planning.facts import Fact, placed_thing, preconditions, region_name
from ator_ros.planning.values import Binding, Symbol, Value, Values, after
from ator_ros.planning.wanted import bindings_for, groups_of
from ator_ros.tops.chain import Top
from ator_ros.tops.objects import followed


@dataclass(frozen=True, slots=True)
class PlannedStep:
    """A TOP with a goal.

    Attributes
    ----------
    top : Top
        The TOP.
    binding : tuple
        Its goal variables, as pairs of name and symbol; those that are missing are chosen later.
    region : tuple of Fact
        What must hold of the place that is chosen, for the TOP that comes to need it; empty where the goal is
        determined otherwise.
    """

    top: Top
    binding: tuple[tuple[str, Symbol], ...] = ()
    region: tuple[Fact, ...] = ()

    def needs(self) -> list[Fact]:
        """Return the facts that must hold before."""
        return preconditions(self.top, dict(self.binding))

    def values(self) -> dict[str, Value]:
        """Return the variables that it changes."""
        return after(self.top, dict(self.binding))


def steps_for(wanted: Sequence[Fact], tops: Sequence[Top]) -> list[PlannedStep]:
    """Return the TOPs with the goals from which plans for `wanted` are made.

    A goal is where an object is that the TOP follows, or what is wanted, or a place from which another of
    these steps may start.
    """
    groups = groups_of(wanted)
    direct = [PlannedStep(top, binding) for top in tops for binding in _bindings(top, groups)]
    near = [step for top in tops for target in direct for step in _toward(top, target)]
    return list(dict.fromkeys((*direct, *near)))


def _bindings(top: Top, groups: Sequence[Sequence[object]]) -> Iterator[tuple[tuple[str, Symbol], ...]]:
    name = followed(top)
    own: dict[str, Symbol] = {} if name is None else {"x": f"{name}.x", "y": f"{name}.y"}
    if own or not _places_something(top):
        yield _sorted(own)
    for group in groups:
        for found in bindings_for(group, top):  # type: ignore[arg-type]
            yield _sorted({**found, **own})


def _sorted(binding: Binding) -> tuple[tuple[str, Symbol], ...]:
    return tuple(sorted(binding.items()))


def _places_something(top: Top) -> bool:
    return top.arrives or bool(top.post.goal_names() & {"x", "y"})


def _toward(top: Top, target: PlannedStep) -> Iterator[PlannedStep]:
    """Yield `top` with goals from which `target` may start, one for each thing that must be somewhere."""
    if followed(top) is not None:
        return
    facts = target.needs()
    for thing in dict.fromkeys(filter(None, (placed_thing(fact.said) for fact in facts))):
        region = region_name(target.top, dict(target.binding), thing)
        binding: Binding = {axis: f"{region}.{axis}" for axis in "xy"}
        placed = after(top, binding)
        if all(_symbol(placed, f"{thing}.{axis}") == binding[axis] for axis in "xy"):
            yield PlannedStep(top, _sorted(binding), tuple(fact for fact in facts if fact.region == region))


def _symbol(values: Values, name: str) -> Symbol | None:
    value = values.get(name)
    return None if value is None else value.symbol
