"""How reports name and draw what is a domain's own; all of it may be left out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ator_ros.refinement.chain_prediction import PredictsPerformance
from ator_ros.robot.description import Robot
from ator_ros.tops.library import TopLibrary

Models = Mapping[str, PredictsPerformance]
Captioned = tuple[Any, str]
"""A figure of matplotlib and its caption."""
Line = Sequence[tuple[float, float]]
"""The corners of a line on the floor, x and y in m."""


def nothing_around(axes: Any, robot: Robot) -> None:
    """Draw no surroundings."""


def no_lines(robot: Robot) -> Sequence[Line]:  # noqa: ARG001
    """Return no lines."""
    return ()


def no_figures(robot: Robot, models: Models, library: TopLibrary) -> Sequence[Captioned]:  # noqa: ARG001
    """Return no figures."""
    return ()


@dataclass(frozen=True)
class Presentation:
    """Words and drawings of a domain for the reports of its evaluations.

    Attributes
    ----------
    draw : callable
        Draws the surroundings to axes, in m.
    lines : callable
        Returns the lines on the floor that a view shows beside the scene's area and bays.
    place : str
        What the first subgoal of a chain is, in a word.
    chains : mapping
        What a chain is, by its name.
    policies : mapping
        What a policy chooses in this domain, by its name, where the general words say too little.
    published : mapping
        Mean absolute and root-mean-square error in s of published models, by action.
    table1 : tuple
        Published rows of Table 1: what it is of, then Total, Higher, Equal and Lower.
    title, figures
        Title of a section of figures, and a callable that returns them for a robot, learned models by action,
        and a TOP library. Without figures there is no section.
    """

    draw: Callable[[Any, Robot], None] = nothing_around
    lines: Callable[[Robot], Sequence[Line]] = no_lines
    place: str = "subgoal"
    chains: Mapping[str, str] = field(default_factory=dict)
    policies: Mapping[str, str] = field(default_factory=dict)
    published: Mapping[str, str] = field(default_factory=dict)
    table1: tuple[tuple[str, ...], ...] = ()
    title: str = "Figures"
    figures: Callable[[Robot, Models, TopLibrary], Sequence[Captioned]] = no_figures
