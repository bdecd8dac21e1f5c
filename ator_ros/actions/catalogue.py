"""The action sets that the TOP library offers by name."""

from __future__ import annotations

from collections.abc import Mapping

from ator_ros.actions.base import Action
from ator_ros.actions.bezier.dribble_ball import DribbleBall as BezierDribbleBall
from ator_ros.actions.bezier.go_to_pose import GoToPose as BezierGoToPose
from ator_ros.actions.bezier.shoot import Shoot as BezierShoot
from ator_ros.actions.planned.dribble_ball import DribbleBall
from ator_ros.actions.planned.go_to_pose import GoToPose
from ator_ros.actions.planned.shoot import Shoot

ActionSet = Mapping[str, type[Action]]

ACTION_SETS: dict[str, ActionSet] = {
    "default": {action.name: action for action in (GoToPose, DribbleBall, Shoot)},
    "bezier": {action.name: action for action in (BezierGoToPose, BezierDribbleBall, BezierShoot)},
}
