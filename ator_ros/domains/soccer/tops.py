"""The TOPs of soccer: their conditions say what each is for (paper, section 2.1)."""

from __future__ import annotations

import math

from ator_ros.actions.base import Point
from ator_ros.tops.conditions import Condition, Region, Term
from ator_ros.tops.relations import Bearing, Distance
from ator_ros.tops.top import Top

_HELD = Condition((Term("hold.x", "ball.x", 0.12), Term("hold.y", "ball.y", 0.12)))

GO_TO_POSE = Top(
    "goToPose",
    "goToPose",
    Condition(),
    Condition(
        (
            Term("robot.x", "goal.x", 0.06),
            Term("robot.y", "goal.y", 0.06),
            Term("robot.yaw", "goal.yaw", 0.12),
        )
    ),
)
# The paper's goToBall: the same action, its goal the ball. How the robot stands there is left open.
GO_TO_BALL = Top(
    "goToBall",
    "goToPose",
    Condition((Term("ball.x", "goal.x", 0.1), Term("ball.y", "goal.y", 0.1))),
    Condition((Term("hold.x", "ball.x", 0.1), Term("hold.y", "ball.y", 0.1))),
    Point.HOLD,
)
DRIBBLE_BALL = Top(
    "dribbleBall",
    "dribbleBall",
    _HELD,
    Condition(
        (
            Term("hold.x", "goal.x", 0.06),
            Term("hold.y", "goal.y", 0.06),
            Term("ball.x", "hold.x", 0.1),
            Term("ball.y", "hold.y", 0.1),
        )
    ),
    Point.HOLD,
)
# The goal's position is the middle of the goal's mouth; the net stops the ball 0.7 m behind the line at most.
# A dribble ends up to 0.16 m beside its goal, and refinement keeps so far inside: it puts the ball 0.9 to
# 2.5 m before the mouth, and at 0.9 m within 50 degrees of the middle.
SHOOT = Top(
    "shoot",
    "shoot",
    Condition(
        _HELD.terms,
        (
            Distance("ball", "goal", 0.74, 2.66),
            Bearing("ball", "goal", math.radians(60.0), math.pi, mirrored=True),
        ),
    ),
    Condition((Region("ball.x", "goal.x", 0.0, 0.7, outward=True), Term("ball.y", "goal.y", 1.0))),
    Point.HOLD,
    settles=6.0,
)

TOPS = (GO_TO_POSE, GO_TO_BALL, DRIBBLE_BALL, SHOOT)
