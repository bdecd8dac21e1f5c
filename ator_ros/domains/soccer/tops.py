"""The TOPs of soccer (paper, section 2.1)."""

from __future__ import annotations

import dataclasses
import math

from ator_ros.actions.base import Point
from ator_ros.bases.description import Robot
from ator_ros.domains.drive import GO_TO_POSE
from ator_ros.domains.soccer.field import Field, field_of
from ator_ros.tops.chain import Top
from ator_ros.tops.conditions import Bearing, Condition, Distance, Region, Term
from ator_ros.tops.objects import held_within

_NET = 0.1  # m by which a ball may lie deeper than the goal, as the net yields
_USUAL_FIELD = Field(8.0, 5.0, goal_width=2.0, goal_depth=0.6)


def go_to_ball(held: float = 0.1) -> Top:
    """Return the paper's goToBall: goToPose with the ball as its goal, and with any heading.

    The ball is held up to `held` m from the hold, along x and y.
    """
    at_ball = Condition((Term("ball.x", "goal.x", 0.1), Term("ball.y", "goal.y", 0.1)))
    return Top("goToBall", "goToPose", at_ball, _holding(held), Point.HOLD)


def dribble_ball(held: float = 0.1, lost: float = 0.12) -> Top:
    """Return dribbleBall.

    `held` is as for `go_to_ball`; at the start the ball may be up to `lost` m from the hold, along
    x and y.
    """
    at_goal = (
        Term("hold.x", "goal.x", 0.06),
        Term("hold.y", "goal.y", 0.06),
        Term("ball.x", "hold.x", held),
        Term("ball.y", "hold.y", held),
    )
    return Top("dribbleBall", "dribbleBall", _holding(lost), Condition(at_goal), Point.HOLD)


def shoot(field: Field = _USUAL_FIELD, lost: float = 0.12) -> Top:
    """Return shoot, whose goal is the middle of a goal's mouth.

    As a dribble ends up to 0.16 m from its goal, refinement places the ball 0.9 to 2.5 m before the
    mouth, and at 0.9 m within 50 degrees of the middle.
    """
    region = (
        Distance("ball", "goal", 0.74, 2.66),
        Bearing("ball", "goal", math.radians(60.0), math.pi, mirrored=True, center=field.x),
    )
    behind_line = Region(
        "ball.x", "goal.x", 0.0, field.goal_depth + _NET, outward=True, center=field.x
    )
    inside = Condition((behind_line, Term("ball.y", "goal.y", field.goal_width / 2)))
    return Top(
        "shoot",
        "shoot",
        Condition(_holding(lost).terms, region),
        inside,
        Point.HOLD,
        settles=6.0,
    )


def _holding(most: float) -> Condition:
    return Condition((Term("hold.x", "ball.x", most), Term("hold.y", "ball.y", most)))


GO_TO_BALL = go_to_ball()
DRIBBLE_BALL = dribble_ball()
SHOOT = shoot()
TOPS = (GO_TO_POSE, GO_TO_BALL, DRIBBLE_BALL, SHOOT)
"""The TOPs for the fins and the goals of the shipped description."""


def tops_for(robot: Robot) -> tuple[Top, ...]:
    """Return the TOPs for the fins of a robot and the goals of its field.

    Without fins, or without goals, the sizes are those of the shipped description.
    """
    if robot.holder is None:
        return TOPS
    held = held_within(robot)
    lost = robot.holder_length
    field = field_of(robot)
    if not field.goal_depth:
        field = dataclasses.replace(_USUAL_FIELD, x=field.x, y=field.y)
    shot = shoot(field, lost)
    return GO_TO_POSE, go_to_ball(held), dribble_ball(held, lost), shot
