"""The goals of soccer that plans can be asked for by name."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from ator_ros.domains.soccer.field import field_of
from ator_ros.domains.soccer.tops import tops_for
from ator_ros.robot.description import Robot
from ator_ros.tops.conditions import Condition


def goals(robot: Robot) -> Mapping[str, Condition]:
    """Return the goals: the ball held, and on a field with goals the ball in the one at x > 0."""
    field = field_of(robot)
    posts = {top.name: top.post for top in tops_for(robot)}
    found = {"ball_held": posts["goToBall"]}
    if field.goal_depth:
        centre = dict(zip(("goal.x", "goal.y"), field.goal_centre(), strict=True))
        inside = (dataclasses.replace(term, target=centre[str(term.target)]) for term in posts["shoot"].terms)
        found["ball_in_goal"] = Condition(tuple(inside))
    return found
