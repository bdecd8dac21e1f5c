"""Soccer as a domain: its action sets with what each action learns from, and its goals by name."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from ator_ros.actions import DEFAULT_SET
from ator_ros.actions.situation import ActionSpec
from ator_ros.bases.description import Robot
from ator_ros.domains.domain import Domain
from ator_ros.domains.soccer import samplers
from ator_ros.domains.soccer.chains import CHAINS
from ator_ros.domains.soccer.field import BALL, field_in, field_lines, field_of
from ator_ros.domains.soccer.go_to_ball import GoToPoseOrBall
from ator_ros.domains.soccer.holding import DribbleBall
from ator_ros.domains.soccer.shoot import Shoot
from ator_ros.domains.soccer.thresholds import RANGES
from ator_ros.domains.soccer.tops import TOPS, tops_for
from ator_ros.geometry import FloatArray, wrap_angles
from ator_ros.performance.derived import Geometry, from_hold
from ator_ros.performance.features import PATHS, Feature, names_of, variables
from ator_ros.tops.conditions import Condition

_TO_MOUTH = variables("x y yaw xg yg")


def _hold_dist(geometry: Geometry) -> FloatArray:
    return geometry.once(from_hold)[0]


def _hold_angle(geometry: Geometry) -> FloatArray:
    bearing = geometry.once(from_hold)[1]
    return np.abs(wrap_angles(bearing - geometry.direct["yaw"]))


def _hold_off_axis(geometry: Geometry) -> FloatArray:
    return np.abs(geometry.once(from_hold)[1])


def _heading_off_axis(geometry: Geometry) -> FloatArray:
    return np.abs(wrap_angles(geometry.direct["yaw"]))


SHOT = (
    Feature("hold_dist", "m", _TO_MOUTH, _hold_dist),
    Feature("hold_angle", "rad", _TO_MOUTH, _hold_angle),
    Feature("hold_off_axis", "rad", _TO_MOUTH, _hold_off_axis),
    Feature("heading_off_axis", "rad", variables("yaw"), _heading_off_axis),
)
"""Features of a shot.

The ball is held. The goal lies on the field's x axis; its yaw is not used.
"""

_SHOOTING = (*names_of(SHOT), "v", *names_of(PATHS))

ACTION_SETS: Mapping[str, tuple[ActionSpec, ...]] = MappingProxyType(
    {
        DEFAULT_SET: (
            ActionSpec("goToPose", GoToPoseOrBall, samplers.go_to_pose),
            ActionSpec("dribbleBall", DribbleBall, samplers.dribble_ball),
            ActionSpec("shoot", Shoot, samplers.shoot_with_room, _SHOOTING),
        ),
    }
)


def goals(robot: Robot) -> Mapping[str, Condition]:
    """Return the goals of plans by name.

    "ball_held" is a held ball. On a field with goals, "ball_in_goal" is the ball in the goal at
    greater x.
    """
    field = field_of(robot)
    posts = {top.name: top.post for top in tops_for(robot)}
    found = {"ball_held": posts["goToBall"]}
    if field.goal_depth:
        x, y = field.goal_center()
        center = {"goal.x": x, "goal.y": y}
        terms = posts["shoot"].terms
        inside = [dataclasses.replace(term, target=center[str(term.target)]) for term in terms]
        found["ball_in_goal"] = Condition(tuple(inside))
    return found


SOCCER = Domain(
    "soccer",
    TOPS,
    ACTION_SETS,
    (BALL,),
    CHAINS,
    variables=RANGES,
    bays=field_in,
    features=SHOT,
    lines=field_lines,
    goals=goals,
    fitted=tops_for,
)
