"""Plan the fastest manoeuvre that is clear of an object and of the walls of bays."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ator_ros.actions.base import ActionError
from ator_ros.bases.differential.durations import Rates, rates_of
from ator_ros.bases.differential.limits import Limits
from ator_ros.bases.differential.manoeuvre import (
    SIDE,
    SPEED_PIECES,
    TURN_PIECES,
    Manoeuvre,
    Side,
    close,
    is_forward,
    write_pieces,
)
from ator_ros.bases.differential.paths import Ends, entries_of, exits_of, find_paths
from ator_ros.bases.differential.robot import DifferentialRobot
from ator_ros.bases.differential.trajectory import most_states, write_states
from ator_ros.compiled import compiled, elementwise
from ator_ros.domains.planned.walls import (
    EndBays,
    box_distance,
    end_bays,
    touches_walls,
    wall_distance,
)
from ator_ros.geometry import FloatArray, Pose, Record, Records
from ator_ros.world.state import ObjectState

# s between the states that are checked, coarse and fine: 6 cm at full speed
_INTERVALS = (0.25, 0.05)
_MARGIN = 0.04  # m of free space around an object: a noisy position may be that wrong
_CLEARING = np.arange(0.0, 1.5, 0.01)  # m: lengths of straight drives away from an object


@dataclass(frozen=True, slots=True)
class Obstacles:
    """What a manoeuvre must not touch.

    Attributes
    ----------
    thing : ObjectState or None
        A round object at rest.
    radius : float
        Its radius in m.
    run : float
        Length in m of the run at the end in which it may be touched.
    """

    thing: ObjectState | None = None
    radius: float = 0.0
    run: float = 0.0


def is_free(
    start: Pose,
    goal: Pose,
    obstacles: Obstacles,
    robot: DifferentialRobot,
) -> bool:
    """Return whether the robot touches no obstacle at the start of a motion to `goal`.

    Poses are those of the axle. The object may be touched within the run at the end.
    """
    pose = np.array([start])
    thing = obstacles.thing
    if touches_walls(pose, robot):
        return False
    if thing is None or start.distance(goal) <= obstacles.run:
        return True
    return bool(distances_to(obstacles, pose, robot)[0] >= _MARGIN)


def distance_to_clear(
    start: Pose,
    goal: Pose,
    obstacles: Obstacles,
    robot: DifferentialRobot,
) -> float:
    """Return the distance in m (negative: backward) of a straight drive that clears the object.

    It is 0 if the robot is clear at the start, or if each drive comes nearer to the object or
    touches a wall. A robot that never drives backward cannot leave an object at its front.
    """
    thing = obstacles.thing
    if thing is None or is_free(start, goal, obstacles, robot):
        return 0.0
    if touches_walls(np.array([start]), robot):
        return 0.0
    found = list[float]()
    signs: tuple[float, ...] = (-1.0, 1.0)
    if not robot.limits.backward:
        at_front = start.relative(Pose(thing.x, thing.y, 0.0)).x > robot.front
        signs = () if at_front else (1.0,)
    for sign in signs:
        drives = sign * _CLEARING
        poses = np.array([start.ahead(drive) for drive in drives])
        distances = distances_to(obstacles, poses, robot)
        clear = distances >= _MARGIN
        until = slice(int(np.argmax(clear)) + 1)
        nearer = distances[until].min() < distances[0] - 1e-9
        if clear.any() and not nearer and not touches_walls(poses[until], robot):
            found.append(float(drives[until][-1]))
    return min(found, key=abs, default=0.0)


def distances_to(obstacles: Obstacles, poses: FloatArray, robot: DifferentialRobot) -> FloatArray:
    """Return the distances in m between the robot and the object's surface, shape (n,).

    Poses of the robot have the shape (n, 3): x, y in m, yaw in rad. Infinite without an object.
    """
    thing = obstacles.thing
    if thing is None:
        return np.full(len(poses), np.inf)
    x, y, yaw = poses.T
    distances = _outline_distance(thing.x - x, thing.y - y, yaw, _outline(robot))
    return np.asarray(distances - obstacles.radius)


class Outline(NamedTuple):
    """The robot's outline, and the bays of its scene, in m."""

    front: float
    rear: float
    half_width: float
    fin_tip: float
    fin_side: float
    reach: float
    bays: EndBays


def _outline(robot: DifferentialRobot) -> Outline:
    return Outline(
        front=float(robot.front),
        rear=float(robot.rear),
        half_width=float(robot.half_width),
        fin_tip=float(robot.tip),
        fin_side=float(robot.tip_half_width),
        reach=float(robot.reach),
        bays=end_bays(robot),
    )


@elementwise
def _outline_distance(
    dx: Any,
    dy: Any,
    yaw: Any,
    shape: Outline,
) -> Any:
    """Return the distance from the robot's outline to points that lie (dx, dy) m from its axle."""
    c = np.cos(yaw)
    s = np.sin(yaw)
    ahead = c * dx + s * dy
    left = np.abs(c * dy - s * dx)
    body = box_distance(
        ahead,
        left,
        -shape.rear,
        shape.front,
        -shape.half_width,
        shape.half_width,
    )
    fins = box_distance(
        ahead,
        left,
        shape.front,
        shape.fin_tip,
        -shape.fin_side,
        shape.fin_side,
    )
    return np.minimum(body, fins)


class RoundObstacle(NamedTuple):
    """An object that must not be touched, in m: center (NaN: none), radius, and the run to it."""

    x: float
    y: float
    radius: float
    run: float


class Surroundings(NamedTuple):
    """The limits, the robot with the bays, and an object, relative to the center of the area."""

    rates: Rates
    outline: Outline
    thing: RoundObstacle


def surroundings(robot: DifferentialRobot, limits: Limits, obstacles: Obstacles) -> Surroundings:
    """Return the surroundings in which manoeuvres within `limits` are checked."""
    thing = obstacles.thing
    area = robot.scene.area
    x, y = (np.nan, np.nan) if thing is None else (thing.x - area.x, thing.y - area.y)
    in_the_way = RoundObstacle(
        x=float(x),
        y=float(y),
        radius=float(obstacles.radius),
        run=float(obstacles.run),
    )
    return Surroundings(rates_of(limits), _outline(robot), in_the_way)


def from_center(pose: Pose, robot: DifferentialRobot) -> Pose:
    """Return a pose relative to the center of the area, with floats."""
    x, y, yaw = pose
    area = robot.scene.area
    return Pose(
        float(x - area.x),
        float(y - area.y),
        float(yaw),
    )


@compiled
def is_clear(
    start: Pose,
    goal: Pose,
    first: float,
    last: float,
    drive: float,
    entry: Record,
    leaving: Record,
    around: Surroundings,
    forward: bool,
) -> bool:
    """Return whether a manoeuvre is clear and, if `forward`, never drives backward.

    The parameters are those of a `Manoeuvre`: turns `first` and `last` in rad, `drive` in m, and
    the sides `entry` and `leaving`, of `SIDE`. Poses are relative to the center of the area.
    """
    speeds = np.empty((SPEED_PIECES, 3))
    turns = np.empty((TURN_PIECES, 3))
    duration = write_pieces(
        speeds,
        turns,
        first,
        last,
        drive,
        entry,
        leaving,
        around.rates,
    )
    if forward and not is_forward(speeds, drive, around.rates):
        return False
    for interval in _INTERVALS:
        states = np.empty((most_states(duration, interval), 5))
        count = write_states(states, speeds, turns, duration, start, goal, interval)
        if _touches(states[:count], goal, around.outline, around.thing):
            return False
    return True


@compiled
def _touches(
    states: FloatArray,
    goal: Pose,
    shape: Outline,
    thing: RoundObstacle,
) -> bool:
    """Return whether the robot touches a wall or the object in any state; see `write_states`."""
    for index in range(len(states)):
        x = abs(states[index, 0])
        y = abs(states[index, 1])
        if x > shape.bays.line - shape.reach:
            distance = wall_distance(x, y, shape.bays)
            if distance < shape.reach:
                return True
    if math.isnan(thing.x):
        return False
    end = len(states) - 1
    if thing.run > 0.0:  # in the run the object is straight ahead
        while (
            end >= 0 and math.hypot(states[end, 0] - goal.x, states[end, 1] - goal.y) <= thing.run
        ):
            end -= 1
    near = max(shape.reach, math.hypot(max(shape.front, shape.rear), shape.half_width))
    near += thing.radius + _MARGIN
    for index in range(end + 1):
        dx = thing.x - states[index, 0]
        dy = thing.y - states[index, 1]
        if abs(dx) < near and abs(dy) < near:
            distance = _outline_distance(dx, dy, states[index, 2], shape)
            if distance - thing.radius < _MARGIN:
                return True
    return False


# Candidates of turns, as shares of the limits: changes of speed without an object, and at the end
# of a run to one; then speeds between the slowest and the fastest at the beginning of a run.
_SHARES = (-1.0, -0.85, -0.7, -0.55, -0.4, -0.25, -0.1, 0.0, 0.1, 0.25, 0.4, 0.55, 0.7, 0.85, 1.0)
_RUN_CHANGES = (-1.0, -0.75, -0.5, -0.25, -0.1, 0.0, 0.1, 0.25, 0.5, 0.75, 1.0)
_RUN_SHARES = (0.0, 0.35, 0.6, 0.8, 1.0)
TRIES = 10_000
"""Greatest number of paths that are checked, in 2 us each.

In 6000 dribbles that began at speed the last success was try 4225.
"""
_LONGER = 0.05  # s that closing a path may add; some then need a drive back of seconds


def _free_sides(limits: Limits, speed: float) -> list[Side]:
    """Return candidate sides without an object: an immediate turn, at several changes of speed.

    Sides that are backward from the beginning are left out if the base never drives so.
    """
    change = min(limits.a, limits.brake)  # the direction of driving decides which of them applies
    least = -1.0 if limits.backward or speed > 0.0 else 0.0
    shares = [share for share in _SHARES if share >= least]
    return [Side(0.0, speed, speed, share * change, limits.w) for share in shares]


@lru_cache(maxsize=16)
def run_exits(limits: Limits, speed: float, length: float) -> Ends:
    """Return the exits at `speed` (m/s) with a straight run of `length` m to an object."""
    # Exits are backward in time: a gain of speed here is braking in the drive.
    fastest_ = math.sqrt(speed * speed + 2.0 * limits.brake * length)
    slowest = math.sqrt(max(0.0, speed * speed - 2.0 * limits.a * length))
    speeds = {slowest + share * (min(limits.v, fastest_) - slowest) for share in _RUN_SHARES}
    change = min(limits.a, limits.brake)  # a turn that begins in reverse loses speed first
    sides = []
    for at in sorted(speeds):
        for share in _RUN_CHANGES:
            if share < 0.0 and at <= 0.0 and not limits.backward:
                continue
            most = limits.brake if share > 0.0 else change
            sides.append(Side(length, speed, at, share * most, limits.w))
    return exits_of(sides, limits)


@lru_cache(maxsize=16)
def free_entries(
    limits: Limits,
    speed: float,
    *,
    stops: bool = True,
) -> Ends:
    """Return the entries at `speed` (m/s): an immediate turn and, if `stops`, one after a stop."""
    sides = _free_sides(limits, speed)
    if stops and speed != 0.0:
        stop = math.copysign(0.5 * speed * speed / limits.brake, speed)
        standing = _free_sides(limits, 0.0)
        sides += [side._replace(length=stop, outer_speed=speed) for side in standing]
    return entries_of(sides, limits)


@lru_cache(maxsize=16)
def free_exits(limits: Limits, speed: float) -> Ends:
    """Return the exits at `speed` (m/s) with a turn."""
    return exits_of(_free_sides(limits, speed), limits)


def fastest(
    robot: DifferentialRobot,
    start: Pose,
    goal: Pose,
    entries: Ends,
    exits: Ends,
    limits: Limits,
    obstacles: Obstacles,
    *,
    forward_only: bool = False,
    tries: int = TRIES,
    longest: float = math.inf,
) -> Manoeuvre:
    """Return the fastest clear manoeuvre.

    Parameters
    ----------
    robot : DifferentialRobot
        The robot, with its scene.
    start, goal : Pose
        Poses of the axle at both ends.
    entries, exits : Ends
        Candidates for the turns at both ends.
    limits : Limits
        Limits of the manoeuvre.
    obstacles : Obstacles
        The object, if it must not be touched.
    forward_only : bool
        Whether the robot must not drive backward.
    tries : int
        Number of paths that are checked, the fastest first.
    longest : float
        Greatest duration in s.

    Raises
    ------
    ActionError
        There is none.
    """
    if not is_free(start, goal, obstacles, robot):
        raise ActionError(
            f"expected a start clear of objects and walls, got ({start.x:.2f}, {start.y:.2f}) m, "
            f"which is too near one of them{_only_forward(limits)}"
        )
    paths = find_paths(
        start,
        goal,
        entries,
        exits,
        limits,
        forward=forward_only,
        longest=longest,
        most=tries,
    )
    found, first, last, drive = _first_clear(
        from_center(start, robot),
        from_center(goal, robot),
        paths,
        entries.sides,
        exits.sides,
        surroundings(robot, limits, obstacles),
        forward_only,
    )
    if found < 0:
        raise ActionError(
            f"expected a free path from ({start.x:.2f}, {start.y:.2f}) m "
            f"to ({goal.x:.2f}, {goal.y:.2f}) m, found none{_only_forward(limits)}"
        )
    entry = entries.sides[paths[found]["entry"]]
    exit_ = exits.sides[paths[found]["exit"]]
    sides = Side(*entry.tolist()), Side(*exit_.tolist())
    return Manoeuvre(start, goal, *sides, first, last, drive, limits)


def _only_forward(limits: Limits) -> str:
    """Return the setting that leaves out paths backward, for a message."""
    return "" if limits.backward else "; the robot never drives backward (limits.v_back: 0)"


def turn_on_spot(
    robot: DifferentialRobot, start: Pose, yaw: float, limits: Limits, obstacles: Obstacles
) -> Manoeuvre:
    """Plan to turn to the heading `yaw` (rad) from rest.

    Parameters
    ----------
    robot : DifferentialRobot
        The robot, with its scene.
    start : Pose
        Pose of the axle.
    yaw : float
        Heading at the end in rad.
    limits : Limits
        Limits of the turn.
    obstacles : Obstacles
        The object, if it must not be touched.

    Raises
    ------
    ActionError
        The robot would touch something.
    """
    turn = Side(0.0, 0.0, 0.0, 0.0, limits.w)
    goal = start._replace(yaw=yaw)
    side = np.array([turn], dtype=SIDE)[0]
    around = surroundings(robot, limits, obstacles)
    begin = from_center(start, robot)
    end = from_center(goal, robot)
    angle = float(start.relative(goal).yaw)
    if not is_clear(begin, end, angle, 0.0, 0.0, side, side, around, False):
        raise ActionError(
            f"expected room to turn at ({start.x:.2f}, {start.y:.2f}) m, there is none"
        )
    return Manoeuvre(start, goal, turn, turn, angle, 0.0, 0.0, limits)


@compiled
def _first_clear(
    start: Pose,
    goal: Pose,
    paths: Records,
    entries: Records,
    exits: Records,
    around: Surroundings,
    forward: bool,
) -> tuple[int, float, float, float]:
    """Return the index of the first clear path, its turns and drive after closing; -1: none."""
    speeds = np.empty((SPEED_PIECES, 3))
    turns = np.empty((TURN_PIECES, 3))
    for index in range(len(paths)):
        path = paths[index]
        entry = entries[path.entry]
        leaving = exits[path.exit]
        first = path.first
        last = path.last
        drive = path.drive
        if is_clear(start, goal, first, last, drive, entry, leaving, around, forward):
            first, last, drive, found = close(
                first,
                last,
                start,
                goal,
                entry,
                leaving,
                around.rates,
            )
            time = write_pieces(
                speeds,
                turns,
                first,
                last,
                drive,
                entry,
                leaving,
                around.rates,
            )
            if not (found and time < path.time + _LONGER):
                continue
            if is_clear(start, goal, first, last, drive, entry, leaving, around, forward):
                return index, first, last, drive
    return -1, 0.0, 0.0, 0.0
