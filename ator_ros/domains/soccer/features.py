"""Soccer's own features: ideal times of driving to a ball, dribbling and shooting, and what aims a shot.

Ideal motions turn, drive straight and turn. With a ball, the greatest turn rate follows from what keeps the
ball pressed to the front (`holding.push`): the slower the robot and harder it brakes, the slower it turns.
The few kinds of motion here were chosen for the Pioneer. For other robots they are chosen from a grid.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache, partial
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ator_ros.domains.soccer.field import field_of
from ator_ros.domains.soccer.planned.holding import ENTRY_RATES, MARGIN, fastest_rate, keeps_ball, push
from ator_ros.domains.soccer.planned.shoot import usual_release
from ator_ros.domains.soccer.run_up_times import run_up_times
from ator_ros.domains.soccer.thresholds import approach_run, passing_distance
from ator_ros.geometry import FloatArray, wrap_angles
from ator_ros.motion.displacements import TurnDriving
from ator_ros.motion.families import Family, FreeTurns, Kind, Motions, TurnProfile, free_kinds, needed_kinds
from ator_ros.performance.derived import Geometry, hold_angle, hold_bearing, hold_dist
from ator_ros.performance.features import Feature, Kinds, MotionFeatures, variables
from ator_ros.printable import quoted
from ator_ros.robot.description import Limits, Robot

AT_ONCE = NO_RUN = np.nan


class PushedTurns(NamedTuple):
    """A kind of motion with the ball; speeds and their changes are shares of the limits.

    Attributes
    ----------
    entry : float
        Speed before the first turn; NaN: the robot's own, as the turn begins at once.
    gain, loss : float
        Of speed in the first turn, and in the last.
    after : float
        Speed after the last turn; NaN: the one at the goal, as the turn ends there.
    slower : int
        By how many steps the last turn is slower (negative: faster) than the ball allows there.
    least_start, least_arrival : float
        Least speeds at the start and at the goal, where these decide how fast the robot may turn.
    rate : float
        Turn rate in the first turn; NaN: the fastest that the ball allows at its begin.
    """

    entry: float
    gain: float
    loss: float
    after: float
    slower: int = 0
    least_start: float = 0.0
    least_arrival: float = 0.0
    rate: float = np.nan


DRIVES = (
    FreeTurns(1.0, 1.0),
    FreeTurns(-0.6, -0.3, backward=True),
    FreeTurns(-1.0, -1.0, backward=True),
    FreeTurns(0.6, 0.3),
    FreeTurns(-0.6, -0.6, backward=True),
    FreeTurns(0.3, 0.6),
    FreeTurns(0.6, 0.6),
    FreeTurns(-0.3, -1.0, backward=True),
)
APPROACHES = (
    FreeTurns(1.0, 0.5, share=0.8),
    FreeTurns(0.3, -0.25, share=0.8),
    FreeTurns(-1.0, -1.0, backward=True, share=0.35),
    FreeTurns(0.1, 0.25),
    FreeTurns(1.0, 1.0, share=1.0),
    FreeTurns(0.6, 0.0, share=1.0),
    FreeTurns(-0.6, -1.0, backward=True, share=0.8),
    FreeTurns(0.1, 0.0, share=0.35),
)
DRIBBLES: tuple[PushedTurns, ...] = (
    PushedTurns(AT_ONCE, 0.75, 0.0, 0.5),
    PushedTurns(0.55, 0.0, 0.0, 0.4),
    PushedTurns(0.1, 0.0, 0.0, 0.1),
    PushedTurns(AT_ONCE, 0.96, 0.5, 0.3),
    PushedTurns(0.2, 0.25, 0.0, 0.4),
    PushedTurns(AT_ONCE, 0.96, 0.5, 0.6),
    PushedTurns(AT_ONCE, 0.96, 0.0, 0.4),
    PushedTurns(0.2, 0.25, 0.0, 0.2),
    PushedTurns(AT_ONCE, 0.96, 0.0, 0.95),
    PushedTurns(0.1, 0.0, 0.0, 0.3),
    PushedTurns(AT_ONCE, 0.96, 0.9, 0.4),
    PushedTurns(AT_ONCE, 0.75, 0.0, 0.75),
)
# Of all robots. Two last turns are a step off what the ball allows, as the shipped models learned with them.
_SHOT_KINDS: tuple[PushedTurns, ...] = (
    PushedTurns(AT_ONCE, 0.75, 0.0, 0.5),
    PushedTurns(AT_ONCE, 0.96, 0.0, 0.75),
    PushedTurns(0.1, 0.0, 0.0, 0.3, slower=1),
    PushedTurns(0.2, 0.25, 0.0, 0.3, slower=-1),
    PushedTurns(0.55, 0.0, 0.0, 0.5),
)


def drive_family(limits: Limits, rows: Iterable[FreeTurns] = DRIVES) -> Family:
    """Return the motions to a pose, forward or in reverse, of a robot with these limits."""
    return Family(limits, free_kinds(limits, rows))


def approach_family(robot: Robot, rows: Iterable[FreeTurns] = APPROACHES) -> Family:
    """Return the motions up to a ball: forward or in reverse to behind it, then straight."""
    kinds = free_kinds(robot.limits, rows)
    return Family(robot.limits, kinds, run=approach_run(robot), passing=passing_distance(robot))


def dribble_family(robot: Robot, rows: Iterable[PushedTurns] = DRIBBLES) -> Family:
    """Return the motions with the ball: forward only, no turn faster than the ball allows."""
    kinds = tuple(_pushed_kind(robot, row) for row in rows)
    return Family(pushing_limits(robot), kinds, run=None, forward=True)


@lru_cache(maxsize=8)
def shot_family(robot: Robot) -> Family:
    """Return the motions with the ball that end in a run at full speed; where it leads there is a choice."""
    return dribble_family(robot, _SHOT_KINDS)


def pushing_limits(robot: Robot) -> Limits:
    """Return the limits with the ball; raises NoHolderError where the robot cannot hold it."""
    return robot.holder_for("pushing a ball").limits


def _pushed_kind(robot: Robot, row: PushedTurns) -> Kind:
    limits = pushing_limits(robot)
    first, last = row.gain * limits.a, row.loss * limits.brake
    begin = row.least_start if np.isnan(row.entry) else row.entry
    end = row.least_arrival if np.isnan(row.after) else row.after
    rate = fastest_rate(robot, begin * limits.v, first) if np.isnan(row.rate) else row.rate * limits.w
    return Kind(
        TurnProfile(first, rate),
        TurnProfile(last, fastest_rate(robot, end * limits.v, -last, row.slower)),
        row.after,
        row.entry * limits.v,
        least_start=row.least_start * limits.v if row.least_start else -np.inf,
        least_arrival=row.least_arrival * limits.v if row.least_arrival else -np.inf,
    )


DRIVE, APPROACH, DRIBBLE = "drive", "approach", "dribble"
"""Names of the families."""

# What to choose from; all numbers are shares of the limits.
_CHANGES = (-1.0, -0.6, -0.25, 0.0, 0.25, 0.6, 1.0)
_RUNS = (0.0, 0.35, 0.8, 1.0)
_LEADS = (0.1, 0.2, 0.35, 0.55, 0.8)
_LEAST = (0.0, 0.25, 0.5, 0.75)
_GAINS, _LOSSES = (0.0, 0.25, 0.5, 0.75, 0.96), (0.0, 0.5, 0.9)
_AFTER = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.75, 0.95)
_BEGINS = [(AT_ONCE, least) for least in _LEAST] + [(lead, 0.0) for lead in _LEADS]
_ENDS = [(NO_RUN, least) for least in _LEAST[1:]] + [(after, 0.0) for after in _AFTER]

Turns = TypeVar("Turns", FreeTurns, PushedTurns)


@lru_cache(maxsize=4)
def chosen_drives(robot: Robot) -> Kinds:
    """Return the kinds of drives, and of approaches if the robot can hold a ball; it takes a second."""
    places, runs = free_grid((0.0,)), free_grid(_RUNS)
    needed = needed_kinds(drive_family(robot.limits, places), hold=0.0)
    holding = [] if robot.holder is None else needed_kinds(approach_family(robot, runs), hold=robot.hold)
    return {DRIVE: _stored(places, needed), APPROACH: _stored(runs, holding)}


@lru_cache(maxsize=4)
def chosen_dribbles(robot: Robot) -> Kinds:
    """Return the kinds of dribbles; it takes two seconds."""
    grid = pushed_grid(robot)
    return {DRIBBLE: _stored(grid, needed_kinds(dribble_family(robot, grid), hold=robot.hold))}


def free_grid(runs: Iterable[float] = _RUNS) -> list[FreeTurns]:
    """Return all kinds of motion of a robot that holds nothing, with speeds before the run from `runs`."""
    return [FreeTurns(*row) for row in itertools.product(_CHANGES, _CHANGES, (False, True), runs)]


def pushed_grid(robot: Robot) -> list[PushedTurns]:
    """Return all kinds of motion that are planned with the ball, with the fastest turns that do not lose it.

    Of a robot that loses it in every turn they are those that it loses last.
    """
    rows = []
    for (entry, start), gain, loss, (after, arrival) in itertools.product(_BEGINS, _GAINS, _LOSSES, _ENDS):
        rate = _first_rate(robot, start if np.isnan(entry) else entry, gain)
        rows.append(PushedTurns(entry, gain, loss, after, 0, start, arrival, rate))
    kinds = dribble_family(robot, rows).kinds
    holding = [row for row, kind in zip(rows, kinds, strict=True) if row.rate and _holds_last(robot, kind)]
    return holding or [row._replace(rate=np.nan) for row in rows]


@lru_cache(maxsize=256)
def _first_rate(robot: Robot, begin: float, gain: float) -> float:
    """Return the greatest planned rate of a first turn that keeps the ball, as a share; 0 where none does."""
    limits = pushing_limits(robot)
    for rate in ENTRY_RATES:
        turn = TurnDriving(begin * limits.v, gain * limits.a, rate * limits.w)
        if keeps_ball(robot, turn, limits.v):
            return rate
    return 0.0


def _holds_last(robot: Robot, kind: Kind) -> bool:
    """Return whether the ball stays in front in the last turn."""
    end = kind.share * pushing_limits(robot).v
    speed = max(kind.least_arrival, 0.0) if np.isnan(end) else end
    return push(robot, speed, kind.last.rate, -kind.last.change) >= MARGIN


def _stored(grid: Sequence[FreeTurns | PushedTurns], which: Iterable[int]) -> list[list[float | None]]:
    return [[None if np.isnan(number) else number for number in grid[at]] for at in which]


def turns_of(kinds: Kinds, family: str, kind: type[Turns]) -> tuple[Turns, ...]:
    """Return the kinds of a family.

    Raises
    ------
    ValueError
        One has too few values or too many.
    """
    rows, fields = kinds.get(family, ()), kind._fields
    for number, row in enumerate(rows):
        if len(row) != len(fields):
            raise ValueError(
                f"{family}.{number}: expected {len(fields)} values ({', '.join(fields)}), got {quoted(row)}"
            )
    values: list[list[Any]] = [[np.nan if value is None else value for value in row] for row in rows]
    return tuple(kind(*row) for row in values)


Fastest = Callable[[Geometry], Motions]
"""Returns the fastest ideal motion in each situation."""
_SHORT = 1.0  # m
# The nine ideal shots to fixed places: share of the mouth's width from its middle, and direction (rad).
_AIMS, _SHOTS = np.array(list(itertools.product((-0.2, 0.0, 0.2), (-0.6, 0.0, 0.6)))).T[:, :, None]


def drives(plain: tuple[FreeTurns, ...] = DRIVES, approaches: tuple[FreeTurns, ...] = APPROACHES) -> Fastest:
    """Return the search for drives of these kinds, and for approaches where a goal is to hold the ball."""
    # What is cached here ends with the model that it belongs to: its tables are large.
    plain_family = lru_cache(maxsize=8)(partial(drive_family, rows=plain))
    approach = lru_cache(maxsize=8)(partial(approach_family, rows=approaches))

    def fastest(geometry: Geometry) -> Motions:
        holding = geometry.direct["hold"] > 0.5
        if holding.all():
            return _to_goal(geometry, approach(geometry.robot))
        found = _not_slower(_to_goal(geometry, plain_family(geometry.robot.limits)), geometry)
        if not holding.any():
            return found
        held = _to_goal(geometry, approach(geometry.robot))
        return Motions(np.where(holding, held.time, found.time), np.where(holding, held.turn, found.turn))

    return fastest


def dribbles(rows: tuple[PushedTurns, ...] = DRIBBLES) -> Fastest:
    """Return the search for dribbles of these kinds."""
    family = lru_cache(maxsize=8)(partial(dribble_family, rows=rows))
    return lambda geometry: _to_goal(geometry, family(geometry.robot))


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
    """Return the features of drives; a robot that holds nothing has no approaches."""
    if DRIVE not in kinds:
        return {}
    search = drives(turns_of(kinds, DRIVE, FreeTurns), turns_of(kinds, APPROACH, FreeTurns))
    return _features("drive", search, _CHOSEN_DRIVES, {n: kinds.get(n, ()) for n in (DRIVE, APPROACH)})


def _dribbles_of(kinds: Kinds) -> dict[str, Feature]:
    if DRIBBLE not in kinds:
        return {}
    search = dribbles(turns_of(kinds, DRIBBLE, PushedTurns))
    return _features("dribble", search, _CHOSEN_DRIBBLES, {DRIBBLE: kinds[DRIBBLE]})


_CHOSEN_DRIVES = MotionFeatures(chosen_drives, _drives_of)
_CHOSEN_DRIBBLES = MotionFeatures(chosen_dribbles, _dribbles_of)


def _features(
    name: str, search: Fastest, chosen: MotionFeatures, kinds: Kinds | None = None
) -> dict[str, Feature]:
    """Return the ideal time and the angle turned on the way, as features."""
    made = partial(Feature, derives=_TO_POSE, motions=chosen, kinds=kinds)
    time, turn = f"{name}_time", f"{name}_turn"
    return {
        time: made(time, "s", compute=lambda g: g.once(search).time, ideal=True),
        turn: made(turn, "rad", compute=lambda g: g.once(search).turn, described=True),
    }


MOTIONS = (
    *_features("drive", drives(), _CHOSEN_DRIVES).values(),
    *_features("dribble", dribbles(), _CHOSEN_DRIBBLES).values(),
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
