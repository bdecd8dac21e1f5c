"""shoot: accelerate straight at the goal, then brake, so that the ball rolls on into it."""

from __future__ import annotations

import itertools
import math
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from ator_ros.actions.base import ActionError, Goal, Status, Step, finished
from ator_ros.bases.differential.durations import Rates, drive_time, rates_of, turn_time
from ator_ros.bases.differential.limits import Limits
from ator_ros.bases.differential.manoeuvre import SIDE, Manoeuvre, Side, pose_after_turn
from ator_ros.bases.differential.paths import Ends, ranked
from ator_ros.bases.differential.robot import DifferentialRobot
from ator_ros.bases.differential.turns import WIDEST, look_up
from ator_ros.compiled import compiled, inlined
from ator_ros.domains.planned.free_paths import (
    Obstacles,
    Surroundings,
    fastest,
    from_center,
    is_clear,
    surroundings,
)
from ator_ros.domains.soccer.field import BALL, ball_of, field_of, is_in_goal
from ator_ros.domains.soccer.holding import HoldingAction, entries_with_ball, release_exits
from ator_ros.geometry import FloatArray, Pose, Record, Records, record_type
from ator_ros.world.state import World

_SLANT = math.radians(60.0)  # greatest angle between a shot and the goal's axis
# Share of the ball's rolling distance at which it is released; the rest is for losses. The robot,
# which brakes harder than the ball, then stops with its axle before the line.
_ROLL_SHARE = 0.62
_ROOM = 0.05  # m between the robot and the goal's posts and walls
_AIMS = (-0.6, -0.3, 0.0, 0.3, 0.6)  # shares of half the goal's width
# rad between a shot and the goal's axis
_SLANTS = tuple(math.radians(angle) for angle in (-50.0, -25.0, 0.0, 25.0, 50.0))
_GRID_TRIES = 1500  # run-ups that are checked
# candidates: turns in rad, and lengths in m by which the straight before a turn is longer
_TURNS: FloatArray = math.radians(1.0) * np.arange(-292, 293, dtype=float)
_LEADS: FloatArray = np.array((0.0, 0.1, 0.2, 0.3, 0.45, 0.7, 1.0, 1.4))


class _Shooting(NamedTuple):
    """Numbers of robot, ball and goal for run-ups: lengths in m, decelerations in m/s^2."""

    rates: Rates
    hold: float
    reach: float
    radius: float  # of the ball
    roll: float  # m per (m/s)^2: see `_roll_of`
    rolling: float  # of the ball
    brake: float
    half_width: float  # of the goal
    depth: float


def _run_up(
    robot: DifferentialRobot, start: Pose, mouth: Pose, entries: Ends, limits: Limits
) -> Manoeuvre | None:
    """Plan the run-up with one turn that has the ball in the goal first.

    None if the posts block all. `mouth` is the middle of the goal's mouth, heading out of the
    field.
    """
    begin = Pose(*map(float, mouth.relative(start)))
    ball = robot.scene.objects[BALL]
    field = field_of(robot)
    shooting = _Shooting(
        rates_of(limits),
        hold=float(robot.hold),
        reach=float(robot.reach),
        radius=float(ball.radius),
        roll=float(_roll_of(robot)),
        rolling=float(ball.rolling_deceleration),
        brake=float(robot.limits.brake),
        half_width=float(field.goal_width / 2.0),
        depth=float(field.goal_depth),
    )
    found = ranked(_run_ups(begin, entries, shooting), _GRID_TRIES)
    around = surroundings(robot, limits, Obstacles())
    index = _first_clear_run_up(from_center(start, robot), found, entries.sides, around)
    if index < 0:
        return None
    _, entry, lead, turn, pushed, released = found[index].tolist()
    side = entries.sides[entry].copy()
    side["length"] = lead
    goal = _end_of(start, found[index], side, around.rates)
    release = Side(0.0, released, released, 0.0, limits.w)
    return Manoeuvre(start, goal, Side(*side.tolist()), release, turn, 0.0, pushed, limits)


_RUN_UP = record_type(
    [
        ("time", float),  # s; until the ball is in
        ("entry", np.intp),  # number of the entry
        ("lead", float),  # m; length of its straight part
        ("turn", float),  # rad
        ("pushed", float),  # m; length of the last straight
        ("released", float),  # m/s; speed at its end
    ]
)


@compiled
def _run_ups(start: Pose, entries: Ends, shooting: _Shooting) -> Records:
    """Return all run-ups on the grid from a pose relative to the goal's mouth."""
    rates = shooting.rates
    sides = entries.sides
    along, across = entries.turns
    found = np.empty(len(_TURNS) * len(sides) * len(_LEADS), dtype=_RUN_UP)
    count = 0
    cos = math.cos(start.yaw)
    sin = math.sin(start.yaw)
    for turn in _TURNS:
        heading = (start.yaw + turn + math.pi) % math.tau - math.pi
        if abs(heading) > _SLANT or abs(turn) > WIDEST:
            continue
        c = math.cos(heading)
        s = math.sin(heading)
        ahead = math.cos(start.yaw + turn)
        aside = math.sin(start.yaw + turn)
        for entry in range(len(sides)):
            side = sides[entry]
            turning = turn_time(turn, side.rate, rates.aw)
            speed = min(max(side.speed + side.change * turning, -rates.v), rates.v)
            forth = look_up(along, entry, turn) + side.speed * turning
            left = look_up(across, entry, turn)
            turned_x = start.x + ahead * forth - aside * left
            turned_y = start.y + aside * forth + ahead * left
            for further in _LEADS:
                lead = side.length + further
                x = turned_x + lead * cos
                y = turned_y + lead * sin
                pushed, released, time = _release(x, y, c, s, speed, shooting)
                if time == np.inf:
                    continue
                time += turning + drive_time(lead, side.outer_speed, side.speed, rates)
                run_up = found[count]
                run_up.time = time
                run_up.entry = entry
                run_up.lead = lead
                run_up.turn = turn
                run_up.pushed = pushed
                run_up.released = released
                count += 1
    return found[:count]


@inlined
def _release(
    x: float,
    y: float,
    c: float,
    s: float,
    speed: float,
    shooting: _Shooting,
) -> tuple[float, float, float]:
    """Return how far (m) and to which speed (m/s) to push a ball, and the time (s) to the goal.

    The straight begins at the axle's place (x, y) in the frame of the goal's mouth, at `speed`, in
    the direction with cosine `c` and sine `s`. The time is infinite if ball or robot would miss the
    mouth.
    """
    ball_x = x + shooting.hold * c
    ball_y = y + shooting.hold * s
    left = (shooting.radius - ball_x) / c
    crossing = ball_y - ball_x * s / c
    if left < 0.0 or (shooting.half_width - abs(crossing)) * c - shooting.reach < _ROOM:
        return 0.0, 0.0, np.inf
    rates = shooting.rates
    roll = shooting.roll
    gaining = (left - roll * speed * speed) / (1.0 + 2.0 * roll * rates.a)
    pushed = max(gaining, left - roll * rates.v * rates.v, 0.0)
    released = min(math.sqrt(speed * speed + 2.0 * rates.a * pushed), rates.v)
    # A turn may end beyond the place of the release, as long as the robot stops inside the goal.
    stop = pushed + released * released / (2.0 * shooting.brake)
    inside = shooting.depth - (x + stop * c)
    beside = shooting.half_width - abs(y + stop * s)
    if min(inside, beside) - shooting.reach < _ROOM:
        return 0.0, 0.0, np.inf
    time = drive_time(pushed, speed, released, rates)
    return pushed, released, time + _rolling_time(shooting.rolling, released, left - pushed)


@compiled
def _rolling_time(deceleration: float, speed: float, distance: float) -> float:
    """Return the time in s in which a ball that is released at `speed` (m/s) rolls `distance` m."""
    left = math.sqrt(max(speed * speed - 2.0 * deceleration * distance, 0.0))
    return float((speed - left) / deceleration)


@compiled
def _first_clear_run_up(start: Pose, found: Records, entries: Records, around: Surroundings) -> int:
    """Return the index of the first run-up that is clear of walls; -1 if none is."""
    sides = np.zeros(2, dtype=SIDE)
    entry = sides[0]
    leaving = sides[1]
    leaving.rate = around.rates.w
    for index in range(len(found)):
        run_up = found[index]
        sides[0] = entries[run_up.entry]
        entry.length = run_up.lead
        leaving.outer_speed = run_up.released
        leaving.speed = run_up.released
        goal = _end_of(start, run_up, entry, around.rates)
        if is_clear(start, goal, run_up.turn, 0.0, run_up.pushed, entry, leaving, around, False):
            return index
    return -1


@compiled
def _end_of(
    start: Pose,
    run_up: Record,
    entry: Record,
    rates: Rates,
) -> Pose:
    """Return the pose at the end of a run-up."""
    x, y, heading = pose_after_turn(start, run_up.turn, entry, rates)
    ahead = run_up.pushed * math.cos(heading)
    aside = run_up.pushed * math.sin(heading)
    return Pose(x + ahead, y + aside, heading)


def _release_poses(robot: DifferentialRobot, mouth: Pose, limits: Limits) -> list[Pose]:
    """Return some poses of the axle from which a ball that is pushed at full speed is released."""
    half = field_of(robot).goal_width / 2.0
    poses = []
    for aim, slant in itertools.product(_AIMS, _SLANTS):
        if half * (1.0 - abs(aim)) * math.cos(slant) - robot.reach >= _ROOM:
            line = robot.scene.radius(BALL) / math.cos(slant)
            back = _roll_of(robot) * limits.v * limits.v - line + robot.hold
            poses.append(mouth.compose(Pose(0.0, aim * half, slant)).ahead(-back))
    return poses


def _time_after(
    robot: DifferentialRobot,
    mouth: Pose,
    released: Pose,
    speed: float,
) -> float:
    """Return the time in s from a release at `speed` (m/s) until the ball is behind the line."""
    ball = mouth.relative(released).ahead(robot.hold)
    rolling = robot.scene.objects[BALL]
    distance = (rolling.radius - ball.x) / math.cos(ball.yaw)
    return _rolling_time(rolling.rolling_deceleration, float(speed), float(distance))


def _roll_of(robot: DifferentialRobot) -> float:
    """Return the distance in m per (m/s)^2 from the goal at which a ball is released."""
    return _ROLL_SHARE / (2.0 * robot.scene.objects[BALL].rolling_deceleration)


_PATIENCE = 2.0  # s from the release until the ball is in the goal
_LARGE = math.radians(200.0)  # turn above which two turns may be faster than one
_MOST_TRIES = 40  # paths that are checked for each pose of the release


class Shoot(HoldingAction):
    """Drives at the goal with the ball and brakes: the ball rolls on over the line.

    The goal's position is the middle of the goal's mouth; its yaw and speed are not used.
    """

    name = "shoot"
    verb = "running up"

    def setup(self) -> None:
        """Compute the tables of run-ups from rest; see `Action.setup`."""
        limits = self.plan_limits
        entries = entries_with_ball(self.robot, limits, 0.0)
        exits = release_exits(self.robot, limits)
        self._check_turns(entries, exits)

    def start(self, world: World, goal: Goal) -> None:
        """Plan the run-up; see `Action.start`."""
        self._released: float | None = None
        super().start(world, Goal(goal.pose, 0.0, goal.point))

    def is_done(self, world: World) -> bool:
        """Return whether the ball is in the goal."""
        ball = ball_of(world)
        robot = self.robot
        if ball is None:
            return False
        return is_in_goal(
            ball,
            self.goal.pose,
            field_of(robot),
            robot.scene.radius(BALL),
        )

    def plan(self, world: World) -> Manoeuvre:
        """Plan the run-up after which the ball is behind the line first."""
        robot = self.robot
        limits = self.plan_limits
        start = world.robot.pose
        side = field_of(robot).side_of(self.goal.pose.x)
        mouth = self.goal.pose._replace(yaw=0.0 if side > 0 else math.pi)
        entries = entries_with_ball(
            robot,
            limits,
            round(max(0.0, world.robot.vx), 3),
        )
        best = _run_up(robot, start, mouth, entries, limits)
        soonest = math.inf
        if best is not None:
            if abs(best.first) < _LARGE:
                return best
            soonest = best.duration + _time_after(robot, mouth, best.goal, best.exit.outer_speed)
        exits = release_exits(robot, limits)
        for pose in _release_poses(robot, mouth, limits):
            longest = soonest - _time_after(robot, mouth, pose, limits.v)
            with suppress(ActionError):
                plan = fastest(
                    robot,
                    start,
                    pose,
                    entries,
                    exits,
                    limits,
                    Obstacles(),
                    forward_only=True,
                    tries=_MOST_TRIES,
                    longest=longest,
                )
                time = plan.duration + _time_after(robot, mouth, plan.goal, plan.exit.outer_speed)
                if time < soonest:
                    best = plan
                    soonest = time
        if best is None:
            raise ActionError(f"{self.name}: expected room for a run-up to the goal, found none")
        return best

    def step(self, world: World) -> Step:
        """Follow the run-up, then brake until the ball is in the goal."""
        if self.is_done(world):
            return finished(Status.SUCCEEDED, "the ball is in the goal")
        if self._released is None:
            return super().step(world)
        ball = ball_of(world)
        late = world.time - self._released > _PATIENCE
        if late or ball is None or ball.is_resting:
            why = "the ball stopped before the goal"
            if self.check(world) is not None:
                return finished(Status.FAILED, why)
            self._released = None  # after a short push the ball is still in front
            return self.replan(world, why)
        return finished(Status.RUNNING, "the ball is rolling")

    def missed(self, world: World) -> str | None:  # noqa: ARG002
        """Return what is missing at the end of the run-up."""
        return "the ball is not released"

    def arrive(self, world: World) -> Step:
        """Release the ball: brake as hard as the base can."""
        self._released = world.time
        return finished(Status.RUNNING, "released the ball")
