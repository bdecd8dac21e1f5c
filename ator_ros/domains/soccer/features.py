"""Soccer's own features: ideal times of driving to a ball, dribbling and shooting, and what aims a shot."""

from __future__ import annotations

import itertools
from functools import lru_cache, partial

import numpy as np

from ator_ros.domains.soccer.chosen_motions import (
    APPROACH,
    DRIBBLE,
    DRIVE,
    chosen_dribbles,
    chosen_drives,
    turns_of,
)
from ator_ros.domains.soccer.families import (
    APPROACHES,
    DRIBBLES,
    DRIVES,
    PushedTurns,
    approach_family,
    dribble_family,
    drive_family,
    shot_family,
)
from ator_ros.domains.soccer.field import field_of
from ator_ros.domains.soccer.planned.release import usual_release
from ator_ros.domains.soccer.run_up_times import run_up_times
from ator_ros.geometry import FloatArray, wrap_angles
from ator_ros.motion.families import Family, FreeTurns, Motions
from ator_ros.performance.derived import Geometry, hold_angle, hold_bearing, hold_dist
from ator_ros.performance.features import Feature, Kinds, MotionFeatures, variables

_SHORT = 1.0  # m
# The nine ideal shots to fixed places: share of the mouth's width from its middle, and direction (rad).
_AIMS, _SHOTS = np.array(list(itertools.product((-0.2, 0.0, 0.2), (-0.6, 0.0, 0.6)))).T[:, :, None]


class Drives:
    """The fastest ideal motions without the ball, or up to it where a goal is to hold it, of some kinds."""

    def __init__(
        self, plain: tuple[FreeTurns, ...] = DRIVES, approaches: tuple[FreeTurns, ...] = APPROACHES
    ) -> None:
        # What is kept here ends with the model that it belongs to: its tables are large.
        self._plain = lru_cache(maxsize=8)(partial(drive_family, rows=plain))
        self._approaches = lru_cache(maxsize=8)(partial(approach_family, rows=approaches))

    def __call__(self, geometry: Geometry) -> Motions:
        """Return the fastest motion in each situation."""
        holding = geometry.direct["hold"] > 0.5
        if holding.all():
            return _to_goal(geometry, self._approaches(geometry.robot))
        plain = _not_slower(_to_goal(geometry, self._plain(geometry.robot.limits)), geometry)
        if not holding.any():
            return plain
        held = _to_goal(geometry, self._approaches(geometry.robot))
        return Motions(np.where(holding, held.time, plain.time), np.where(holding, held.turn, plain.turn))


def _not_slower(motions: Motions, geometry: Geometry) -> Motions:
    """Return the motions, or turning on the spot, driving and turning where that is faster on short drives.

    They have no room to turn while driving.
    """
    time, turn = motions.time, motions.turn
    short = geometry.at_rest & (geometry.dist < _SHORT)
    if not short.any():
        return motions
    to_dest, at_dest = np.abs(geometry.to_dest), np.abs(geometry.at_dest)
    for reverse in (False, True):
        stopping = geometry.turn_drive_turn(reverse=reverse)
        turned = 2.0 * np.pi - to_dest - at_dest if reverse else to_dest + at_dest
        faster = short & (stopping < time)
        time, turn = np.where(faster, stopping, time), np.where(faster, turned, turn)
    return Motions(time, turn)


class Dribbles:
    """The fastest ideal motions with the ball, of some kinds."""

    def __init__(self, rows: tuple[PushedTurns, ...] = DRIBBLES) -> None:
        self._family = lru_cache(maxsize=8)(partial(dribble_family, rows=rows))

    def __call__(self, geometry: Geometry) -> Motions:
        """Return the fastest motion in each situation."""
        return _to_goal(geometry, self._family(geometry.robot))


def _to_goal(geometry: Geometry, family: Family) -> Motions:
    found = geometry.fastest_to(
        family, *geometry.destination, geometry.direct["yawg"], geometry.direct["speedg"]
    )
    return geometry.with_turns(found, family.limits)


def shot(geometry: Geometry) -> Motions:
    """Return the fastest ideal motion with the ball to a run, at full speed, into the goal's mouth."""
    d, robot = geometry.direct, geometry.robot
    back, width = usual_release(robot) + robot.hold, field_of(robot).goal_width
    heading = np.where(d["xg"] > field_of(robot).x, 0.0, np.pi) + _SHOTS
    x = d["xg"] - back * np.cos(heading)
    y = d["yg"] + width * _AIMS - back * np.sin(heading)
    fastest = robot.holder_for("a shot").limits.v
    return geometry.fastest_to(shot_family(robot), x, y, heading, fastest + 0.0 * x)


def run_up(geometry: Geometry) -> FloatArray:
    """Return the time in s until the ball is in the goal, on the fastest run-up with one turn.

    Where there is none, return the time of the fastest shot with two turns.
    """
    d, (x, y, yaw, opening) = geometry.direct, geometry.openings
    right = d["xg"] > field_of(geometry.robot).x
    side, turned = np.where(right, 1.0, -1.0), np.where(right, 0.0, np.pi)
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


def _drives_of(kinds: Kinds) -> dict[str, Feature]:
    """Return the features of drives; a robot that holds nothing has an empty list of approaches."""
    if not kinds.keys() & {DRIVE, APPROACH}:
        return {}
    drives = turns_of(kinds, DRIVE, FreeTurns), turns_of(kinds, APPROACH, FreeTurns, least=0)
    return _drive_features(Drives(*drives), {name: kinds[name] for name in (DRIVE, APPROACH)})


def _dribbles_of(kinds: Kinds) -> dict[str, Feature]:
    """Return the features of dribbles."""
    if DRIBBLE not in kinds:
        return {}
    return _dribble_features(Dribbles(turns_of(kinds, DRIBBLE, PushedTurns)), {DRIBBLE: kinds[DRIBBLE]})


_CHOSEN_DRIVES = MotionFeatures(chosen_drives, _drives_of)
_CHOSEN_DRIBBLES = MotionFeatures(chosen_dribbles, _dribbles_of)


def _drive_features(drives: Drives, kinds: Kinds | None = None) -> dict[str, Feature]:
    made = partial(Feature, derives=_TO_POSE, motions=_CHOSEN_DRIVES, kinds=kinds)
    return {
        "drive_time": made("drive_time", "s", compute=lambda g: g.once(drives).time, ideal=True),
        "drive_turn": made("drive_turn", "rad", compute=lambda g: g.once(drives).turn, described=True),
    }


def _dribble_features(dribbles: Dribbles, kinds: Kinds | None = None) -> dict[str, Feature]:
    made = partial(Feature, derives=_TO_POSE, motions=_CHOSEN_DRIBBLES, kinds=kinds)
    return {
        "dribble_time": made("dribble_time", "s", compute=lambda g: g.once(dribbles).time, ideal=True),
        "dribble_turn": made("dribble_turn", "rad", compute=lambda g: g.once(dribbles).turn, described=True),
    }


MOTIONS = (*_drive_features(Drives()).values(), *_dribble_features(Dribbles()).values())
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
