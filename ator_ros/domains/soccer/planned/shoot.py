"""shoot: send the ball into the goal by motion alone, since the robot has no kicker."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ator_ros.actions.base import ActionError, Goal, Status, Step, finished
from ator_ros.domains.soccer.field import BALL, ball_of, field_of, is_in_goal
from ator_ros.domains.soccer.planned.clearance import (
    TOUCHES,
    Obstacles,
    batches,
    check_points,
    is_clear,
    screened,
    screening_points,
)
from ator_ros.domains.soccer.planned.dribble_ball import HoldingAction
from ator_ros.domains.soccer.planned.holding import release_sides, run_up_sides
from ator_ros.domains.soccer.planned.planner import fastest
from ator_ros.domains.soccer.planned.release import (
    SLANT,
    may_score,
    release,
    release_poses,
    rolling_time,
    scoring_time,
)
from ator_ros.geometry import FloatArray, Pose, wrap_angles
from ator_ros.motion.displacements import TurnDriving, displacement_table, speeds_after
from ator_ros.motion.durations import drive_time, turn_time
from ator_ros.motion.manoeuvre import Bundle, Manoeuvre, Side, side_table
from ator_ros.motion.planning import Planning
from ator_ros.motion.search import search_tables
from ator_ros.robot.description import Limits, Robot
from ator_ros.world.state import World

_BLOCK = 16  # entries in a portion of work
_GRID_TRIES = 3000  # where the posts block so many, there is no room
_TABLE_POINTS = 20
_RUN_UPS_A_POINT = 2_200
_TURNS: FloatArray = math.radians(1.0) * np.arange(-300, 301, dtype=float)
_LEADS: FloatArray = np.array((0.0, 0.1, 0.2, 0.3, 0.45, 0.7, 1.0, 1.4))


def run_up(
    robot: Robot, start: Pose, mouth: Pose, entries: Sequence[Side], limits: Limits
) -> Planning[Manoeuvre | None]:
    """Plan the run-up with one turn that has the ball in the goal first; None where the posts block all.

    Parameters
    ----------
    start : Pose
        Pose of the axle.
    mouth : Pose
        Middle of the goal's mouth, heading out of the field.
    entries : sequence of Side
        How the lead and the turn may be driven; leads are also tried longer.
    """
    found = yield from _run_ups(robot, start, mouth, entries, limits)
    obstacles = Obstacles()
    for which in batches(np.arange(len(found)), found.times):
        touches = np.zeros(len(which), dtype=bool)
        if len(which) > 1:
            yield screening_points(found.times[which])
            touches = screened(start, found.bundle(which), limits, obstacles, robot) == TOUCHES
        for index in which[~touches]:
            yield check_points(found.times[index])
            manoeuvre = found.manoeuvre(int(index))
            if is_clear(manoeuvre, obstacles, robot):
                return manoeuvre
    return None


@dataclass(frozen=True, slots=True)
class _RunUps:
    """Run-ups, fastest first.

    Attributes
    ----------
    sides : ndarray, shape (5, n)
        The numbers of the leads and turns, as in `Bundle`.
    straights : ndarray, shape (3, n)
        Where the last straights begin, seen from the mouth (m, rad).
    turns, distances, released : ndarray, shape (n,)
        Turn in rad, length of the straight in m, speed at its end in m/s.
    times : ndarray, shape (n,)
        Until the ball is in the goal, in s.
    """

    start: Pose
    mouth: Pose
    limits: Limits
    sides: FloatArray
    straights: FloatArray
    turns: FloatArray
    distances: FloatArray
    released: FloatArray
    times: FloatArray

    def __len__(self) -> int:
        return len(self.times)

    def bundle(self, which: NDArray[np.intp]) -> Bundle:
        """Return the manoeuvres of the indices `which`, shape (n,)."""
        released, distance, mouth = self.released[which], self.distances[which], self.mouth
        x, y, heading = self.straights[:, which]
        x, y = x + distance * np.cos(heading), y + distance * np.sin(heading)
        c, s = math.cos(mouth.yaw), math.sin(mouth.yaw)
        goals = np.stack((mouth.x + c * x - s * y, mouth.y + s * x + c * y, mouth.yaw + heading))
        nothing = np.zeros(len(which))
        exits = np.stack((nothing, released, released, nothing, np.full(len(which), self.limits.w)))
        return Bundle(goals, self.sides[:, which], exits, self.turns[which], nothing, distance)

    def manoeuvre(self, index: int) -> Manoeuvre:
        """Return one of them."""
        length, outer, *turn = self.sides[:, index].tolist()
        released, distance = float(self.released[index]), float(self.distances[index])
        last = Pose(*self.straights[:, index].tolist()).ahead(distance)
        return Manoeuvre(
            self.start,
            self.mouth.compose(last),
            Side(length, outer, TurnDriving(*turn)),
            Side(0.0, released, TurnDriving(released, 0.0, self.limits.w)),
            float(self.turns[index]),
            0.0,
            distance,
            self.limits,
        )


def _run_ups(
    robot: Robot, start: Pose, mouth: Pose, entries: Sequence[Side], limits: Limits
) -> Planning[_RunUps]:
    """Find the `_GRID_TRIES` fastest run-ups on the grid."""
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
    return _RunUps(start, mouth, limits, columns[:5], columns[5:8], *columns[8:])


def _of_sides(
    robot: Robot,
    seen: Pose,
    sides: FloatArray,
    table: FloatArray,
    turns: FloatArray,
    limits: Limits,
    latest: float,
) -> FloatArray:
    """Find run-ups of up to `latest` s with some of the sides, shape (12, n), in the order of `_RunUps`."""
    headings = wrap_angles(seen.yaw + turns)
    length, outer, speed, acceleration, rate = sides[:, :, None]
    leads = length + _LEADS
    lead_times, turning = drive_time(leads, outer, speed, limits), turn_time(turns, rate, limits.aw)
    after = speeds_after(speed, acceleration, turning, limits.v)
    c, s = math.cos(seen.yaw), math.sin(seen.yaw)
    x, y = seen.x + c * table[:, 0] - s * table[:, 1], seen.y + s * table[:, 0] + c * table[:, 1]
    likely = may_score(robot, x, y, headings, seen.yaw, leads)
    if math.isfinite(latest):
        likely &= lead_times[:, :, None] + turning[:, None] <= latest
    entry, lead, turn = np.nonzero(likely)
    along, across = leads[entry, lead] + table[entry, 0, turn], table[entry, 1, turn]
    x, y = seen.x + c * along - s * across, seen.y + s * along + c * across
    end = release(robot, x, y, headings[turn], after[entry, turn], limits)
    times = lead_times[entry, lead] + turning[entry, turn] + end.time
    found = np.flatnonzero(end.allowed & (times <= latest))
    entry, lead, turn = entry[found], lead[found], turn[found]
    picked = sides[:, entry]
    picked[0] = leads[entry, lead]
    return np.stack((*picked, x[found], y[found], headings[turn], turns[turn],
                     end.distance[found], end.speed[found], times[found]))  # fmt: skip


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
        one_turn = yield from run_up(robot, start, mouth, entries, limits)
        if one_turn is not None and abs(one_turn.first) < _LARGE:
            return one_turn
        best, soonest = one_turn, math.inf
        if one_turn is not None:
            soonest = scoring_time(robot, mouth, one_turn)
            yield one_turn
        tables = yield from search_tables(entries, release_sides(robot, limits), limits)
        for pose in release_poses(robot, mouth, limits):
            longest = soonest - rolling_time(robot, mouth, pose, limits.v)
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
                time = scoring_time(robot, mouth, plan)
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
