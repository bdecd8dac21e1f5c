"""Plan the fastest manoeuvre to a goal: the candidate entries and exits, and the checks of results."""

from __future__ import annotations

import math
from collections import deque
from functools import lru_cache

import numpy as np

from ator_ros.actions.base import ActionError
from ator_ros.domains.soccer.planned.clearance import (
    OPEN,
    TOUCHES,
    Obstacles,
    batches,
    check_points,
    is_clear,
    is_free,
    screened,
    screening_points,
)
from ator_ros.geometry import Pose
from ator_ros.motion.displacements import TurnDriving
from ator_ros.motion.manoeuvre import Manoeuvre, Side, closed
from ator_ros.motion.planning import Planning
from ator_ros.motion.search import SearchTables, find_candidates, search_tables
from ator_ros.robot.description import Limits, Robot

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
    candidates = yield from find_candidates(start, goal, tables, least_slack, most)
    short = np.searchsorted(candidates.times, most, side="right")
    for which in batches(np.arange(short), candidates.times):
        bounds = candidates.times[which] + _SURPRISE
        verdicts = np.full(len(which), OPEN, dtype=np.int8)
        if len(which) > 1:
            yield screening_points(bounds)
            bundle = candidates.bundle(which)
            verdicts = screened(
                start, bundle, tables.limits, obstacles, robot, bounds, forward_only=forward_only
            )
        for at, verdict in enumerate(verdicts):
            if verdict == TOUCHES:
                tries -= 1
            if verdict != OPEN:
                continue
            if tries <= 0:
                break
            yield check_points(bounds[at])
            manoeuvre = closed(candidates[int(which[at])])
            if manoeuvre is None or manoeuvre.duration > bounds[at]:
                continue
            # After closing, a drive may be too short for its change of speed: it would have to come back.
            if forward_only and not manoeuvre.is_forward():
                continue
            if is_clear(manoeuvre, obstacles, robot):
                return manoeuvre
            tries -= 1
        if tries <= 0:
            break
    raise ActionError(
        f"expected a free way from ({start.x:.2f}, {start.y:.2f}) m "
        f"to ({goal.x:.2f}, {goal.y:.2f}) m, found none"
    )
