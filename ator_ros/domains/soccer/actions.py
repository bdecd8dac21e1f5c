"""The action sets of soccer by name, with what each action learns from."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from ator_ros.actions import DEFAULT_SET
from ator_ros.actions.specification import ActionSpec
from ator_ros.domains.soccer import situations
from ator_ros.domains.soccer.bezier.dribble_ball import BezierDribbleBall
from ator_ros.domains.soccer.bezier.go_to_pose import BezierGoToPose
from ator_ros.domains.soccer.bezier.shoot import BezierShoot
from ator_ros.domains.soccer.planned import shooting_room
from ator_ros.domains.soccer.planned.dribble_ball import DribbleBall
from ator_ros.domains.soccer.planned.go_to_pose import GoToPose
from ator_ros.domains.soccer.planned.shoot import Shoot
from ator_ros.performance.features import PAPER_3, SIGNED, names_of

# Chosen by `train --ablation`.
_DRIVING = (*names_of(PAPER_3), "drive_time", "drive_turn", "v", "w_by_turn", "speedg", "hold")
_DRIBBLING = (
    *(name for name in (*names_of(PAPER_3), *names_of(SIGNED)) if name != "hold"),
    "dribble_time",
    "dribble_turn",
)
_SHOOTING = ("hold_dist", "hold_angle", "run_up_time", "hold_off_axis", "heading_off_axis", "v")
# `BezierShoot` ends at a fixed place before the line, so its ideal time is `shot_time`.
_SHOOTING_ALONG_CURVES = ("hold_dist", "hold_angle", "shot_time", "hold_off_axis", "heading_off_axis", "v")

ACTION_SETS: Mapping[str, tuple[ActionSpec, ...]] = MappingProxyType(
    {
        DEFAULT_SET: (
            ActionSpec("goToPose", GoToPose, situations.go_to_pose, _DRIVING),
            ActionSpec("dribbleBall", DribbleBall, situations.dribble_ball, _DRIBBLING),
            ActionSpec("shoot", Shoot, shooting_room.shoot, _SHOOTING),
        ),
        "bezier": (
            ActionSpec("goToPose", BezierGoToPose, situations.go_to_pose, _DRIVING),
            ActionSpec("dribbleBall", BezierDribbleBall, situations.dribble_ball, _DRIBBLING),
            ActionSpec("shoot", BezierShoot, situations.shoot, _SHOOTING_ALONG_CURVES),
        ),
    }
)
