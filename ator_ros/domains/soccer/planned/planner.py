"""Plan the fastest manoeuvre to a goal that is clear of the ball and of the goals' walls.

Compiled code checks many candidates at once.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ator_ros.actions.base import ActionError
from ator_ros.compiled import compiled, elementwise
from ator_ros.domains.soccer.field import BALL, box_distance, field_of, touches_goals, wall_distance
from ator_ros.geometry import FloatArray, Pose
from ator_ros.motion.displacements import TurnDriving
from ator_ros.motion.durations import Rates, rates_of
from ator_ros.motion.manoeuvre import (
    SPEED_PIECES,
    TURN_PIECES,
    Bundle,
    Manoeuvre,
    Side,
    close,
    is_forward,
    write_pieces,
)
from ator_ros.motion.planning import Planning
from ator_ros.motion.search import SearchTables, find_candidates, search_tables
from ator_ros.motion.trajectory import DT, most_states, write_states
from ator_ros.robot.description import Limits, Robot
from ator_ros.world.state import ObjectState

_STRIDE = 5
"""Every how many samples of a trajectory are looked at: every 50 ms, 6 cm at full speed."""

_CLEARING = np.arange(0.0, 1.5, 0.01)
"""Lengths in m of straight drives that may lead away from a ball."""


@dataclass(frozen=True, slots=True)
class Obstacles:
    """What a motion must not touch.

    Attributes
    ----------
    ball : ObjectState or None
        The ball, taken as standing still.
    ball_margin : float
        Free distance to keep from the ball in m.
    run : float
        Length in m of the straight run at the end, in which the ball may be touched.
    """

    ball: ObjectState | None = None
    ball_margin: float = 0.04
    run: float = 0.0


def is_free(start: Pose, goal: Pose, obstacles: Obstacles, robot: Robot) -> bool:
    """Return whether the robot touches no obstacle at the start; otherwise no motion to `goal` is clear."""
    pose, ball = np.array([start]), obstacles.ball
    if touches_goals(pose, robot):
        return False
    if ball is None or start.distance(goal) <= obstacles.run:
        return True
    return bool(ball_distances(pose, ball, robot)[0] >= obstacles.ball_margin)


def distance_to_clear(start: Pose, goal: Pose, obstacles: Obstacles, robot: Robot) -> float:
    """Return how far in m (negative: backward) to drive straight until the robot is clear of the ball.

    It is 0 if the robot is clear at the start, or if no straight drive clears it without coming nearer to the
    ball or touching a goal.
    """
    ball = obstacles.ball
    if ball is None or is_free(start, goal, obstacles, robot) or touches_goals(np.array([start]), robot):
        return 0.0
    found = []
    for sign in (-1.0, 1.0):
        ways = sign * _CLEARING
        poses = np.array([start.ahead(way) for way in ways])
        distances = ball_distances(poses, ball, robot)
        clear = distances >= obstacles.ball_margin
        until = slice(int(np.argmax(clear)) + 1)
        nearer = distances[until].min() < distances[0] - 1e-9
        if clear.any() and not nearer and not touches_goals(poses[until], robot):
            found.append(float(ways[until][-1]))
    return min(found, key=abs, default=0.0)


def ball_distances(poses: FloatArray, ball: ObjectState, robot: Robot) -> FloatArray:
    """Return the free distance in m between the robot at each pose, (n, 3), and the ball's surface, (n,)."""
    x, y, yaw = poses.T
    distances = _outline_distance(ball.x - x, ball.y - y, yaw, _outline(robot))
    return np.asarray(distances - robot.scene.radius(BALL))


class _Outline(NamedTuple):
    """The robot's outline and the goals, in m; see `field.wall_distance`."""

    front: float
    rear: float
    half_width: float
    fin_tip: float
    fin_side: float
    reach: float
    line: float
    half: float
    depth: float


def _outline(robot: Robot) -> _Outline:
    field = field_of(robot)
    lengths = (
        robot.front, robot.rear, robot.half_width, robot.tip, robot.tip_half_width, robot.reach,
        field.walls_begin, field.goal_width / 2, field.goal_depth,
    )  # fmt: skip
    return _Outline(*map(float, lengths))


@elementwise
def _outline_distance(dx: Any, dy: Any, yaw: Any, shape: _Outline) -> Any:
    """Return the distance from the robot's outline to points that lie (dx, dy) m from its axle."""
    c, s = np.cos(yaw), np.sin(yaw)
    ahead, left = c * dx + s * dy, np.abs(c * dy - s * dx)
    body = box_distance(ahead, left, -shape.rear, shape.front, -shape.half_width, shape.half_width)
    fins = box_distance(ahead, left, shape.front, shape.fin_tip, -shape.fin_side, shape.fin_side)
    return np.minimum(body, fins)


IMPOSSIBLE, TOUCHES, CLEAR = 0, 1, 2
"""Verdicts on a manoeuvre: it is not allowed, it touches something, or it can be driven."""


class _BallObstacle(NamedTuple):
    """A ball that is in the way, in m: its center (NaN: none), radius, margin, and the run to it."""

    x: float
    y: float
    radius: float
    margin: float
    run: float


def checked(
    start: Pose,
    bundle: Bundle,
    limits: Limits,
    obstacles: Obstacles,
    robot: Robot,
    longest: FloatArray | None = None,
    *,
    forward_only: bool = False,
) -> tuple[NDArray[np.int8], Bundle]:
    """Close manoeuvres, and check whether they can be driven.

    Parameters
    ----------
    start : Pose
        Where all of them start.
    longest : ndarray, shape (n,), optional
        Greatest duration in s, once closed; None: they are closed already, and take any time.

    Returns
    -------
    verdicts : ndarray of int8, shape (n,)
        `IMPOSSIBLE`, `TOUCHES` or `CLEAR`.
    closed : Bundle
        The manoeuvres, closed; those that cannot be closed are impossible.
    """
    ball, area = obstacles.ball, robot.scene.area
    x, y = (np.nan, np.nan) if ball is None else (ball.x - area.x, ball.y - area.y)
    in_the_way = (x, y, robot.scene.radius(BALL), obstacles.ball_margin, obstacles.run)
    # Walls are mirrored, so places are relative to the center of the area.
    goals = bundle.goals - np.array([[area.x], [area.y], [0.0]])
    closed = Bundle(*(np.array(column, dtype=float, order="C") for column in bundle._replace(goals=goals)))
    verdicts = _judge(
        Pose(*map(float, (start.x - area.x, start.y - area.y, start.yaw))),
        closed,
        rates_of(limits),
        _outline(robot),
        _BallObstacle(*map(float, in_the_way)),
        np.full(len(bundle.first), np.inf) if longest is None else np.ascontiguousarray(longest),
        longest is None,
        forward_only,
    )
    return verdicts, closed._replace(goals=bundle.goals)


@compiled
def _judge(
    start: Pose,
    many: Bundle,
    bounds: Rates,
    shape: _Outline,
    ball: _BallObstacle,
    longest: FloatArray,
    are_closed: bool,
    forward: bool,
) -> NDArray[np.int8]:
    verdicts = np.full(len(longest), IMPOSSIBLE, dtype=np.int8)
    speeds, turns = np.empty((SPEED_PIECES, 3)), np.empty((TURN_PIECES, 3))
    states = np.empty((0, 5))
    for row in range(len(longest)):
        entry, leaving = many.entries[:, row].copy(), many.exits[:, row].copy()
        goal = Pose(many.goals[0, row], many.goals[1, row], many.goals[2, row])
        first, last, distance = many.first[row], many.last[row], many.distance[row]
        if not are_closed:
            first, last, distance, found = close(first, last, start, goal, entry, leaving, bounds)
            if not found:
                continue
            many.first[row], many.last[row], many.distance[row] = first, last, distance
        duration = write_pieces(speeds, turns, first, last, distance, entry, leaving, bounds)
        # After closing, a drive may be too short for its change of speed: the robot would have to come back.
        if duration > longest[row] or (forward and not is_forward(speeds, distance, bounds)):
            continue
        if most_states(duration) > len(states):
            states = np.empty((2 * most_states(duration), 5))
        count = write_states(states, speeds, turns, duration, start, goal)
        verdicts[row] = TOUCHES if _touches(states[:count], goal, shape, ball) else CLEAR
    return verdicts


@compiled
def _touches(states: FloatArray, goal: Pose, shape: _Outline, ball: _BallObstacle) -> bool:
    """Return whether the robot touches a wall or the ball in any of the states; see `write_states`."""
    for index in range(0, len(states), _STRIDE):
        x, y = abs(states[index, 0]), abs(states[index, 1])
        if x > shape.line - shape.reach:
            distance = wall_distance(x, y, shape.line, shape.half, shape.depth)
            if distance < shape.reach:
                return True
    if math.isnan(ball.x):
        return False
    end = len(states) - 1
    if ball.run > 0.0:  # in the run the ball lies straight ahead
        while end >= 0 and math.hypot(states[end, 0] - goal.x, states[end, 1] - goal.y) <= ball.run:
            end -= 1
    near = max(shape.reach, math.hypot(max(shape.front, shape.rear), shape.half_width))
    near += ball.radius + ball.margin
    for index in range(0, end + 1, _STRIDE):
        dx, dy = ball.x - states[index, 0], ball.y - states[index, 1]
        is_near = abs(dx) < near and abs(dy) < near
        if is_near and _outline_distance(dx, dy, states[index, 2], shape) - ball.radius < ball.margin:
            return True
    return False


_SAMPLES = 32_000  # of trajectories, in a batch of work
_LARGEST = 64  # manoeuvres in a batch


def batches(order: NDArray[np.intp], times: FloatArray) -> Iterator[NDArray[np.intp]]:
    """Divide the indices `order` into batches of about the same work, the first of a single one.

    `times` are the durations in s, ascending, of all manoeuvres that the indices are of.
    """
    size = 1
    while len(order):
        yield order[:size]
        order = order[size:]
        if len(order):
            size = max(2, min(16 * size, _LARGEST, int(_SAMPLES * DT / max(times[order[0]], DT))))


def check_points(duration: float) -> int:
    """Return the cost in points of a manoeuvre of `duration` s that is followed; see `planning`."""
    return 15 + int(duration / 1.5)


def screening_points(durations: FloatArray) -> int:
    """Return the cost of checking manoeuvres of some `durations` (s), shape (n,)."""
    return int(4.0 + 0.2 * len(durations) + 0.02 * float(durations.sum()))


_SHARES = (-1.0, -0.85, -0.7, -0.55, -0.4, -0.25, -0.1, 0.0, 0.1, 0.25, 0.4, 0.55, 0.7, 0.85, 1.0)
_RUN_CHANGES = (-1.0, -0.75, -0.5, -0.25, -0.1, 0.0, 0.1, 0.25, 0.5, 0.75, 1.0)
_RUN_SHARES = (0.0, 0.35, 0.6, 0.8, 1.0)
_SURPRISE = 0.03  # s
_GRID_ERROR = 0.3  # s by which a candidate's duration is off at most
# In 2200 planned approaches and dribbles, the last success was try 2002, beside a post.
_TRIES = 3000
# m; closing a candidate changes its drive: room so that the robot need not drive back
_SLACK = 0.01


@lru_cache(maxsize=256)
def free_sides(limits: Limits, speed: float, length: float) -> tuple[Side, ...]:
    """Return candidate sides without a ball: turn at once (`length` 0), at several changes of speed."""
    change = min(limits.a, limits.brake)  # which of them it is depends on the direction of driving
    return tuple(Side(length, speed, TurnDriving(speed, share * change, limits.w)) for share in _SHARES)


@lru_cache(maxsize=256)
def run_sides(limits: Limits, speed: float, length: float) -> tuple[Side, ...]:
    """Return candidate exits with a straight run of `length` m up to the ball, arriving at `speed`."""
    # Seen from the goal, backward in time: what gains speed here brakes there.
    fastest_ = math.sqrt(speed * speed + 2.0 * limits.brake * length)
    slowest = math.sqrt(max(0.0, speed * speed - 2.0 * limits.a * length))
    speeds = {slowest + share * (min(limits.v, fastest_) - slowest) for share in _RUN_SHARES}
    change = min(limits.a, limits.brake)  # the turn may begin in reverse: then it loses speed first
    return tuple(
        Side(length, speed, TurnDriving(at, share * (limits.brake if share > 0.0 else change), limits.w))
        for at in sorted(speeds)
        for share in _RUN_CHANGES
    )


@lru_cache(maxsize=64)
def prepare(entries: tuple[Side, ...], exits: tuple[Side, ...], limits: Limits) -> None:
    """Fill the caches of `search_tables`, and load compiled code."""
    deque(search_tables(entries, exits, limits), maxlen=0)


def fastest(
    robot: Robot,
    start: Pose,
    goal: Pose,
    tables: SearchTables,
    obstacles: Obstacles,
    *,
    forward_only: bool = False,
    tries: int = _TRIES,
    longest: float = math.inf,
) -> Planning[Manoeuvre]:
    """Plan the fastest allowed manoeuvre among the `tries` fastest ones of up to about `longest` s.

    Raises
    ------
    ActionError
        No manoeuvre between the poses is clear of the obstacles.
    """
    if not is_free(start, goal, obstacles, robot):
        raise ActionError(
            f"expected a start clear of ball and goals, got ({start.x:.2f}, {start.y:.2f}) m, "
            "which is too near one of them"
        )
    least_slack = _SLACK if forward_only else -math.inf
    most = longest + _GRID_ERROR
    candidates, times = yield from find_candidates(start, goal, tables, least_slack, most)
    short = np.searchsorted(times, most, side="right")
    for which in batches(np.arange(short), times):
        bounds = times[which] + _SURPRISE
        yield screening_points(bounds) if len(which) > 1 else check_points(bounds[0])
        verdicts, closed = checked(
            start,
            candidates.part(which),
            tables.limits,
            obstacles,
            robot,
            bounds,
            forward_only=forward_only,
        )
        first = int(np.append(np.flatnonzero(verdicts == CLEAR), len(which))[0])
        tries -= int(np.count_nonzero(verdicts[:first] == TOUCHES))
        if tries <= 0:
            break
        if first < len(which):
            if len(which) > 1:
                yield check_points(bounds[first])
            return closed.manoeuvre(first, start, tables.limits)
    raise ActionError(
        f"expected a free way from ({start.x:.2f}, {start.y:.2f}) m "
        f"to ({goal.x:.2f}, {goal.y:.2f}) m, found none"
    )
