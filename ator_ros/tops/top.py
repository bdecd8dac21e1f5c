"""Teleo-operators: an action with its pre- and post-condition (paper, section 2.1; Nilsson 1994)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ator_ros.actions.base import Point
from ator_ros.robot.description import Robot
from ator_ros.tops.conditions import Condition, Term


@dataclass(frozen=True, slots=True)
class Top:
    """A teleo-operator.

    Attributes
    ----------
    name : str
        Name in the TOP library.
    action : str
        Name of the action that it executes.
    pre : Condition
        Region from which executing the action will eventually make `post` hold.
    post : Condition
        Intended effect: the goal variables that it names say what the step is for.
    point : Point
        Point of the robot that the goal's position is meant for.
    settles : float
        Time in s that objects may move on after the action has ended, until `post` holds.
    """

    name: str
    action: str
    pre: Condition
    post: Condition
    point: Point = Point.AXLE
    settles: float = 0.0

    @property
    def needs_holder(self) -> bool:
        """Whether its goal or its conditions are about the robot's hold."""
        return (
            self.point is Point.HOLD
            or any(
                str(side).startswith("hold.")
                for term in (*self.pre.terms, *self.post.terms)
                for side in (term.variable, term.target)
            )
            or any("hold" in relation.places for relation in (*self.pre.relations, *self.post.relations))
        )

    def lacks(self, robot: Robot) -> str | None:
        """Return in words what the TOP needs and the robot lacks; None if there is nothing."""
        lacking = self.needs_holder and robot.holder is None
        return f"{self.name} needs a holder; robot {robot.name} has none" if lacking else None

    @property
    def place_tolerance(self) -> float:
        """Distance in m by which a place may miss the goal, by the tolerances of the post-condition."""
        terms = (term for term in self.post.terms if term.variable.endswith(".x"))
        return math.fsum(term.tolerance for term in terms if isinstance(term, Term))

    @property
    def arrives(self) -> bool:
        """Whether the robot ends at the goal: the post-condition places its axle or its hold."""
        return any(term.variable in ("robot.x", "hold.x") for term in self.post.terms)
