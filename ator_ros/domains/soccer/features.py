"""Soccer's own features: ideal times of driving to a ball, dribbling and shooting, and what aims a shot."""

from __future__ import annotations

import itertools

import numpy as np

from ator_ros.domains.soccer.families import approach_family, dribble_family, drive_family, shot_family
from ator_ros.domains.soccer.field import field_of
from ator_ros.domains.soccer.planned.release import usual_release
from ator_ros.domains.soccer.run_up_times import run_up_times
from ator_ros.geometry import FloatArray, wrap_angles
from ator_ros.motion.families import Family
from ator_ros.motion.ideal_times import Motions
from ator_ros.performance.derived import Geometry
from ator_ros.performance.features import Feature, variables
from ator_ros.performance.hold import hold_angle, hold_bearing, hold_dist

# The nine ideal shots to fixed places: share of the mouth's width from its middle, and direction (rad).
_AIMS, _SHOTS = np.array(list(itertools.product((-0.2, 0.0, 0.2), (-0.6, 0.0, 0.6)))).T[:, :, None]


def drive(geometry: Geometry) -> Motions:
    """Return the fastest ideal motion without the ball, or up to it where the goal is to hold one."""
    holding = geometry.direct["hold"] > 0.5
    if holding.all():
        return _to_goal(geometry, approach_family(geometry.robot))
    plain = _to_goal(geometry, drive_family(geometry.robot.limits))
    if not holding.any():
        return plain
    approach = _to_goal(geometry, approach_family(geometry.robot))
    return Motions(np.where(holding, approach.time, plain.time), np.where(holding, approach.turn, plain.turn))


def dribble(geometry: Geometry) -> Motions:
    """Return the fastest ideal motion with the ball."""
    return _to_goal(geometry, dribble_family(geometry.robot))


def _to_goal(geometry: Geometry, family: Family) -> Motions:
    return geometry.fastest_to(
        family, *geometry.destination, geometry.direct["yawg"], geometry.direct["speedg"]
    )


def shot(geometry: Geometry) -> Motions:
    """Return the fastest ideal motion with the ball to a run, at full speed, into the goal's mouth."""
    d, robot = geometry.direct, geometry.robot
    back, width = usual_release(robot) + robot.hold, field_of(robot).goal_width
    heading = np.where(d["xg"] > 0.0, 0.0, np.pi) + _SHOTS
    x = d["xg"] - back * np.cos(heading)
    y = d["yg"] + width * _AIMS - back * np.sin(heading)
    fastest = robot.holder_for("a shot").limits.v
    return geometry.fastest_to(shot_family(robot), x, y, heading, fastest + 0.0 * x)


def run_up(geometry: Geometry) -> FloatArray:
    """Return the time in s until the ball is in the goal, on the fastest run-up with one turn.

    Where there is none, return the time of the fastest shot with two turns.
    """
    d, (x, y, yaw, opening) = geometry.direct, geometry.openings
    side = np.where(d["xg"] > 0.0, 1.0, -1.0)
    turned = np.where(d["xg"] > 0.0, 0.0, np.pi)
    times = run_up_times(
        geometry.robot, np.stack((side * (x - d["xg"]), side * (y - d["yg"]), yaw - turned, d["v"]))
    )
    missing = np.isposinf(times)
    if missing.any():
        rows = {name: column[missing] for name, column in d.items()}
        times[missing] = shot(Geometry(rows, geometry.robot)).time - opening[missing]
    result: FloatArray = times + opening
    return result


_TO_POSE = variables("x y yaw v w xg yg yawg speedg hold")
_TO_MOUTH = variables("x y yaw xg yg")

MOTIONS = (
    Feature("drive_time", "s", _TO_POSE, lambda g: g.once(drive).time, ideal=True),
    Feature("drive_turn", "rad", _TO_POSE, lambda g: g.once(drive).turn, described=True),
    Feature("dribble_time", "s", _TO_POSE, lambda g: g.once(dribble).time, ideal=True),
    Feature("dribble_turn", "rad", _TO_POSE, lambda g: g.once(dribble).turn, described=True),
)
"""Ideal times at the robot's limits, and the angles turned on the way."""

SHOT = (
    Feature("hold_dist", "m", _TO_MOUTH, hold_dist),
    Feature("hold_angle", "rad", _TO_MOUTH, lambda g: np.abs(g.once(hold_angle))),
    Feature(
        "shot_time", "s", _TO_MOUTH | {"v", "w"}, lambda g: g.once(shot).time,
        translation=False, rotation=False, ideal=True,
    ),
    Feature(
        "run_up_time", "s", _TO_MOUTH | {"v", "w"}, lambda g: g.once(run_up),
        translation=False, rotation=False, ideal=True,
    ),
    Feature("hold_off_axis", "rad", _TO_MOUTH, lambda g: np.abs(g.once(hold_bearing)), rotation=False),
    Feature(
        "heading_off_axis", "rad", variables("yaw"), lambda g: np.abs(wrap_angles(g.direct["yaw"])),
        rotation=False,
    ),
)  # fmt: skip
"""Of a ball that is held and a goal whose heading doesn't matter, on the field's x axis."""
