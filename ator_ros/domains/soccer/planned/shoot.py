"""shoot: send the ball into the goal by motion alone, since the robot has no kicker.

A run-up ends straight ahead: accelerate, then release the ball to roll between the posts.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from ator_ros.actions.base import ActionError, Goal, Status, Step, finished
from ator_ros.domains.soccer.field import BALL, ball_of, field_of, is_in_goal
from ator_ros.domains.soccer.planned.holding import HoldingAction, release_sides, run_up_sides
from ator_ros.domains.soccer.planned.planner import (
    CLEAR,
    Obstacles,
    batches,
    check_points,
    checked,
    fastest,
    screening_points,
)
from ator_ros.geometry import BoolArray, FloatArray, Pose, wrap_angles
from ator_ros.motion.displacements import displacement_table, speeds_after
from ator_ros.motion.durations import drive_time, turn_time
from ator_ros.motion.manoeuvre import Bundle, Manoeuvre, Side, side_table
from ator_ros.motion.planning import Planning
from ator_ros.motion.search import search_tables
from ator_ros.robot.description import Limits, Robot
from ator_ros.world.state import World

SLANT = math.radians(60.0)  # greatest angle between a shot and the goal's axis
# Share of the way that a ball rolls out which it is sent: the rest makes up for losses. The robot, which
# brakes harder than the ball, then comes to rest with its axle before the line.
_ROLL_SHARE = 0.62
_DOUBT = 1e-9  # m
ROOM = 0.05  # m between the robot and the goal's posts and walls
_AIMS = (-0.6, -0.3, 0.0, 0.3, 0.6)  # shares of half the goal's width
_SLANTS = tuple(math.radians(angle) for angle in (-50.0, -25.0, 0.0, 25.0, 50.0))
_BLOCK = 16  # entries in a portion of work
_GRID_TRIES = 3000  # where the posts block so many, there is no room
_TABLE_POINTS = 20
_RUN_UPS_A_POINT = 2_200
_TURNS: FloatArray = math.radians(1.0) * np.arange(-300, 301, dtype=float)
_LEADS: FloatArray = np.array((0.0, 0.1, 0.2, 0.3, 0.45, 0.7, 1.0, 1.4))


def _run_up(
    robot: Robot, start: Pose, mouth: Pose, entries: Sequence[Side], limits: Limits
) -> Planning[Manoeuvre | None]:
    """Plan the run-up with one turn that has the ball in the goal first; None where the posts block all.

    `mouth` is the middle of the goal's mouth, heading out of the field. The leads of the entries are also
    tried longer.
    """
    found, times = yield from _run_ups(robot, start, mouth, entries, limits)
    obstacles = Obstacles()
    for which in batches(np.arange(len(times)), times):
        several = len(which) > 1
        yield screening_points(times[which]) if several else check_points(times[which[0]])
        verdicts, closed = checked(start, found.part(which), limits, obstacles, robot)
        clear = np.flatnonzero(verdicts == CLEAR)
        if len(clear):
            if several:
                yield check_points(times[which[clear[0]]])
            return closed.manoeuvre(clear[0], start, limits)
    return None


def _run_ups(
    robot: Robot, start: Pose, mouth: Pose, entries: Sequence[Side], limits: Limits
) -> Planning[tuple[Bundle, FloatArray]]:
    """Find the `_GRID_TRIES` fastest run-ups on the grid, and the times in s until the ball is in."""
    yield _TABLE_POINTS
    seen = mouth.relative(start)
    kept = np.flatnonzero(np.abs(wrap_angles(seen.yaw + _TURNS)) <= SLANT)
    table = displacement_table(_TURNS, [side.turn for side in entries], limits)[:, :, kept]
    sides = side_table(entries)
    points = 1 + _BLOCK * len(_LEADS) * len(kept) // _RUN_UPS_A_POINT
    columns, latest = np.zeros((12, 0)), math.inf
    for first in range(0, len(entries), _BLOCK):
        yield points
        block = slice(first, first + _BLOCK)
        found = _of_sides(robot, seen, sides[:, block], table[block], _TURNS[kept], limits, latest)
        columns = np.concatenate((columns, found), axis=1)
        if columns.shape[1] > _GRID_TRIES:
            latest = float(np.partition(columns[-1], _GRID_TRIES - 1)[_GRID_TRIES - 1])
            columns = columns[:, columns[-1] <= latest]
    columns = columns[:, np.argsort(columns[-1], kind="stable")[:_GRID_TRIES]]
    x, y, heading, turns, distance, released, times = columns[5:]
    x, y = x + distance * np.cos(heading), y + distance * np.sin(heading)
    c, s = math.cos(mouth.yaw), math.sin(mouth.yaw)
    goals = np.stack((mouth.x + c * x - s * y, mouth.y + s * x + c * y, mouth.yaw + heading))
    nothing = np.zeros(len(times))
    exits = np.stack((nothing, released, released, nothing, np.full(len(times), limits.w)))
    return Bundle(goals, columns[:5], exits, turns, nothing, distance), times


def _of_sides(
    robot: Robot,
    seen: Pose,
    sides: FloatArray,
    table: FloatArray,
    turns: FloatArray,
    limits: Limits,
    latest: float,
) -> FloatArray:
    """Find run-ups of up to `latest` s with some of the sides, shape (12, n).

    Rows: the sides as in `Bundle`; where the last straights begin, seen from the mouth (m, m, rad); turns in
    rad; lengths of the last straights in m; speed at their end in m/s; times in s until the ball is in.
    """
    headings = wrap_angles(seen.yaw + turns)
    length, outer, speed, acceleration, rate = sides[:, :, None]
    leads = length + _LEADS
    lead_times, turning = drive_time(leads, outer, speed, limits), turn_time(turns, rate, limits.aw)
    after = speeds_after(speed, acceleration, turning, limits.v)
    c, s = math.cos(seen.yaw), math.sin(seen.yaw)
    x, y = seen.x + c * table[:, 0] - s * table[:, 1], seen.y + s * table[:, 0] + c * table[:, 1]
    likely = _may_score(robot, x, y, headings, seen.yaw, leads)
    if math.isfinite(latest):
        likely &= lead_times[:, :, None] + turning[:, None] <= latest
    entry, lead, turn = np.nonzero(likely)
    along, across = leads[entry, lead] + table[entry, 0, turn], table[entry, 1, turn]
    x, y = seen.x + c * along - s * across, seen.y + s * along + c * across
    pushed, released, time = _release(robot, x, y, headings[turn], after[entry, turn], limits)
    times = lead_times[entry, lead] + turning[entry, turn] + time
    found = np.flatnonzero(times <= latest)  # not those that take NaN
    entry, lead, turn = entry[found], lead[found], turn[found]
    picked = sides[:, entry]
    picked[0] = leads[entry, lead]
    return np.stack((*picked, x[found], y[found], headings[turn], turns[turn],
                     pushed[found], released[found], times[found]))  # fmt: skip


def _release(
    robot: Robot, x: FloatArray, y: FloatArray, heading: FloatArray, speed: FloatArray, limits: Limits
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return how far (m) to push a ball straight at a goal, how fast (m/s), and the time (s) until it is in.

    Straights begin at poses of the axle in the frame of the goal's mouth (x points out of the field), at a
    speed. Where the mouth is missed, or the robot would brake into the goal, the time is NaN.
    """
    c, s = np.cos(heading), np.sin(heading)
    ball_x, ball_y = x + robot.hold * c, y + robot.hold * s
    way = (robot.scene.radius(BALL) - ball_x) / c
    crossing = ball_y - ball_x * s / c
    room = (field_of(robot).goal_width / 2.0 - np.abs(crossing)) * c - robot.reach
    roll = roll_of(robot)
    gaining = (way - roll * speed * speed) / (1.0 + 2.0 * roll * limits.a)
    pushed = np.maximum(np.maximum(gaining, way - roll * limits.v * limits.v), 0.0)
    reached = np.sqrt(np.maximum(speed * speed + 2.0 * limits.a * pushed, 0.0))
    released = np.minimum(reached, limits.v)
    # A turn may end later than where the ball could be let go, as long as the robot stops inside the goal.
    stop = pushed + released * released / (2.0 * robot.limits.brake)
    inside = field_of(robot).goal_depth - robot.reach - (x + stop * c)
    beside = field_of(robot).goal_width / 2.0 - robot.reach - np.abs(y + stop * s)
    allowed = (way >= 0.0) & (np.abs(heading) <= SLANT)
    allowed &= np.minimum(np.minimum(room, inside), beside) >= ROOM
    time = drive_time(pushed, speed, released, limits) + _rolling_time(robot, released, way - pushed)
    return pushed, released, np.where(allowed, time, np.nan)


def _may_score(
    robot: Robot, x: FloatArray, y: FloatArray, heading: FloatArray, yaw: float, leads: FloatArray
) -> BoolArray:
    """Return which straights may lead between the posts, (sides, leads, turns); some that `_release` forbids.

    They begin at (x, y), each (sides, turns), moved along `yaw` by one of the leads, (sides, leads), in m.
    """
    c, s = np.cos(heading), np.sin(heading)
    ball_x, ball_y, tangent = x + robot.hold * c, y + robot.hold * s, s / c
    widest = field_of(robot).goal_width / 2.0 - (robot.reach + ROOM) / c + _DOUBT
    aside = (math.sin(yaw) - math.cos(yaw) * tangent) * leads[:, :, None]
    aside += (ball_y - ball_x * tangent)[:, None]
    before = (math.cos(yaw) * leads)[:, :, None] <= (robot.scene.radius(BALL) + _DOUBT - ball_x)[:, None]
    return np.asarray((np.abs(aside) <= widest) & before)


def _release_poses(robot: Robot, mouth: Pose, limits: Limits) -> list[Pose]:
    """Return some poses of the axle in the world at which a ball pushed at full speed is released."""
    half, poses = field_of(robot).goal_width / 2.0, []
    for aim, slant in itertools.product(_AIMS, _SLANTS):
        if half * (1.0 - abs(aim)) * math.cos(slant) - robot.reach >= ROOM:
            line = robot.scene.radius(BALL) / math.cos(slant)
            back = roll_of(robot) * limits.v * limits.v - line + robot.hold
            poses.append(mouth.compose(Pose(0.0, aim * half, slant)).ahead(-back))
    return poses


def _scoring_time(robot: Robot, mouth: Pose, plan: Manoeuvre) -> float:
    """Return the time in s from the start of a run-up until the ball is wholly behind the line."""
    return plan.duration + _time_after(robot, mouth, plan.goal, plan.exit.outer_speed)


def _time_after(robot: Robot, mouth: Pose, released: Pose, speed: float) -> float:
    """Return the time in s from the release, there at `speed` (m/s), until the ball is behind the line."""
    ball = mouth.relative(released).ahead(robot.hold)
    way = (robot.scene.radius(BALL) - ball.x) / math.cos(ball.yaw)
    return float(_rolling_time(robot, speed, way))


def _rolling_time(robot: Robot, speed: Any, way: Any) -> FloatArray:
    """Return the time in s in which a ball released at `speed` (m/s) rolls `way` m."""
    deceleration = robot.scene.objects[BALL].rolling_deceleration
    left = np.sqrt(np.maximum(speed * speed - 2.0 * deceleration * way, 0.0))
    return np.asarray((speed - left) / deceleration)


def usual_release(robot: Robot) -> float:
    """Return how far before the goal line, in m, a ball is released at full speed; negative: behind it."""
    speed, radius = robot.holder_for("a shot").limits.v, robot.scene.objects[BALL].radius
    return round(roll_of(robot) * speed * speed - radius, 2)


def roll_of(robot: Robot) -> float:
    """Return how far a ball is sent before it is let go, in m per (m/s)^2."""
    return _ROLL_SHARE / (2.0 * robot.scene.objects[BALL].rolling_deceleration)


_PATIENCE = 2.0
_LARGE = math.radians(200.0)  # beyond which two turns may be better than one
_MOST_TRIES = 40  # for each way to release: where the posts block so many, another release is better


class Shoot(HoldingAction):
    """Drives at the goal with the ball and brakes: the ball rolls on over the line.

    The goal's position is the middle of the goal's mouth; its yaw and speed are not used, since what
    counts is the ball.
    """

    name = "shoot"
    verb = "running up"
    plans_in_motion = False  # toward the goal the way that this takes may be what a run-up lacks

    def setup(self) -> None:
        """Compute the tables of run-ups from rest; see `Action.setup`."""
        limits = self.plan_limits
        self.prepare(run_up_sides(self.robot, limits, 0.0), release_sides(self.robot, limits))

    def start(self, world: World, goal: Goal) -> None:
        """Plan the run-up; see `Action.start`."""
        self._released: float | None = None
        super().start(world, Goal(goal.pose, 0.0, goal.point))

    def plan(self, world: World) -> Planning[Manoeuvre]:
        """Plan the run-up that brings the ball behind the line first."""
        robot, limits, start = self.robot, self.plan_limits, world.robot.pose
        side = field_of(robot).side_of(self.goal.pose.x)
        mouth = self.goal.pose._replace(yaw=0.0 if side > 0 else math.pi)
        speed = round(max(0.0, world.robot.v), 3)
        entries = run_up_sides(robot, limits, speed)
        one_turn = yield from _run_up(robot, start, mouth, entries, limits)
        if one_turn is not None and abs(one_turn.first) < _LARGE:
            return one_turn
        best, soonest = one_turn, math.inf
        if one_turn is not None:
            soonest = _scoring_time(robot, mouth, one_turn)
            yield one_turn
        tables = yield from search_tables(entries, release_sides(robot, limits), limits)
        for pose in _release_poses(robot, mouth, limits):
            longest = soonest - _time_after(robot, mouth, pose, limits.v)
            with suppress(ActionError):
                plan = yield from fastest(
                    robot,
                    start,
                    pose,
                    tables,
                    Obstacles(),
                    forward_only=True,
                    tries=_MOST_TRIES,
                    longest=longest,
                )
                time = _scoring_time(robot, mouth, plan)
                if time < soonest:
                    best, soonest = plan, time
                    yield plan
        if best is None:
            raise ActionError(f"{self.name}: expected room for a run-up to the goal, found none")
        return best

    def step(self, world: World) -> Step:
        """Follow the run-up, then brake until the ball is in the goal."""
        ball, robot = ball_of(world), self.robot
        if ball and is_in_goal(ball, self.goal.pose, field_of(robot), robot.scene.radius(BALL)):
            return finished(Status.SUCCEEDED, "the ball is in the goal")
        if self._released is None:
            return super().step(world)
        over = world.time - self._released > _PATIENCE or ball is None or ball.is_resting
        if over:
            why = "the ball stopped before the goal"
            if self.check(world) is not None:
                return finished(Status.FAILED, why)
            self._released = None  # so short a push has left it in front
            return self.replan(world, why)
        return finished(Status.RUNNING, "the ball is rolling")

    def missed(self, world: World) -> str | None:  # noqa: ARG002
        """Return what is missing: where the ball is released the goal is not reached yet."""
        return "the ball is not released"

    def arrive(self, world: World) -> Step:
        """Release the ball by braking as hard as the base can."""
        self._released = world.time
        return finished(Status.RUNNING, "released the ball")
