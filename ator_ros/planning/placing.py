"""Numbers for what a plan leaves open: placeholders, which refinement replaces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ator_ros.geometry import BoolArray, FloatArray, wrap_angles
from ator_ros.planning.facts import Fact, placed_thing, resolved
from ator_ros.planning.values import reach_about
from ator_ros.tops.chain import Top
from ator_ros.tops.conditions import State, Statement, lookup

_SPACING = 0.1
_MOST_STEPS = 400
"""Along each side of the area: large areas are searched more coarsely."""
_LEAST_WAY = 0.5
"""Distance in m from where a thing lies below which no place is looked for: so short a way is no step."""


def place_in(
    region: Sequence[Fact], top: Top, state: State, edges: tuple[float, float, float, float]
) -> tuple[float, float] | None:
    """Return the place (m) in a region that is nearest to where its thing lies; None where there is none.

    Parameters
    ----------
    region : sequence of Fact
        What must hold there.
    top : Top
        The TOP that brings the thing there: the place keeps the distance that it may miss by, where it can.
    state, edges
        Where everything is before, and where to look: x_min, y_min, x_max, y_max in m.
    """
    thing = placed_thing(region[0].said)
    goal = resolved(dict(region[0].binding), state)
    places = _candidates(edges, goal)
    there = {**state, f"{thing}.x": places[:, 0], f"{thing}.y": places[:, 1]}
    clearance = np.min([_clearance(fact, there, state) for fact in region], axis=0)
    for room in (top.place_tolerance, 0.0):
        good = places[np.broadcast_to(clearance >= room - 1e-9, len(places))]
        if len(good):
            x, y = _nearest(good, state.get(f"{thing}.x", 0.0), state.get(f"{thing}.y", 0.0))
            return x, y
    return None


def _candidates(edges: tuple[float, float, float, float], goal: Mapping[str, float]) -> FloatArray:
    """Return places inside the edges, shape (n, 2), and the goal itself."""
    x_min, y_min, x_max, y_max = edges
    spacing = max(_SPACING, (x_max - x_min) / _MOST_STEPS, (y_max - y_min) / _MOST_STEPS)
    xs = np.arange(x_min, x_max + spacing / 2, spacing)
    ys = np.arange(y_min, y_max + spacing / 2, spacing)
    grid = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
    return np.vstack([grid, [goal.get("x", 0.0), goal.get("y", 0.0)]])


def _clearance(fact: Fact, there: Mapping[str, Any], state: State) -> Any:
    """Return by how much a fact holds at each place, negative where it does not."""
    goal = resolved(dict(fact.binding), state)
    if not isinstance(fact.said, Statement):
        clearance = fact.said.clearance(there, goal)
        return -np.inf if clearance is None else clearance
    term = fact.said
    target: Any = lookup(term.target, there, goal) if isinstance(term.target, str) else term.target
    if target is None or term.variable not in there:
        return -np.inf
    difference = there[term.variable] - target
    if term.variable.endswith("yaw"):
        difference = wrap_angles(np.asarray(difference))
    low, high = reach_about(term, float(target))
    return np.minimum(difference - low, high - difference)


def _nearest(places: FloatArray, x: float, y: float) -> tuple[float, float]:
    """Return the place nearest to a point, but no nearer than `_LEAST_WAY` if there is another."""
    away = np.hypot(places[:, 0] - x, places[:, 1] - y)
    far: BoolArray = away >= _LEAST_WAY
    index = int(np.argmin(np.where(far, away, np.inf))) if far.any() else int(np.argmax(away))
    return float(places[index, 0]), float(places[index, 1])
