"""The paper's actions, each along a Bezier curve that is recomputed at every tick (section 3).

They are the action set `bezier` of soccer, which an entry point of `ator_ros.action_sets` adds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ator_ros.actions.base import Action, ActionError, Goal, Status, Step, finished
from ator_ros.actions.situation import ActionSpec
from ator_ros.bases.description import Robot
from ator_ros.bases.differential.limits import Limits
from ator_ros.bases.differential.robot import differential
from ator_ros.domains.planned.planned_action import check_arrival
from ator_ros.domains.planned.walls import depth_in_walls, nearest_to_walls
from ator_ros.domains.soccer import samplers
from ator_ros.domains.soccer.field import (
    BALL,
    ball_of,
    behind_line,
    field_of,
    is_in_goal,
)
from ator_ros.domains.soccer.thresholds import ball_clearance, check_held, lost_ball
from ator_ros.geometry import FloatArray, Pose, wrap_angle
from ator_ros.performance.features import PAPER_11, names_of
from ator_ros.tops.objects import is_at_front
from ator_ros.world.state import (
    CONTROL_PERIOD,
    STOP,
    Command,
    ObjectState,
    RobotState,
    Standstill,
    World,
)

# rad: greatest bearing of the middle control point that a curve is computed with
_STRAIGHT_BEHIND = 3.1
_SAMPLES = 40  # places on a curve that is shown
_STEP = 0.05  # m between places on the shortest path
# m along the axis from the run-in to behind the goal, and to either side
_CORRIDOR = (-0.02, 0.06, 0.05)


@dataclass(frozen=True, slots=True)
class Style:
    """How an action drives along its curve.

    Attributes
    ----------
    radius : float
        Radius in m of the circle beside the goal on which the curve arrives.
    run_in : float
        Length in m of the straight line before the goal.
    ahead : float
        Length in m of the path from a standing robot to the middle control point.
    per_speed : float
        Growth of that length with the robot's speed, in s, as commands take effect late.
    sharpest : float
        Greatest curvature in 1/m; far above 1/wheel track is turning on the spot.
    rotation : float
        Greatest rotational velocity in rad/s within the limits, which bounds the speed.
    braking : float
        Deceleration in m/s^2 before the goal and before sharper curves.
    """

    radius: float
    run_in: float
    ahead: float
    per_speed: float
    sharpest: float
    rotation: float
    braking: float


@dataclass(frozen=True, slots=True)
class _Curve:
    """A Bezier curve of degree four, from the robot's heading into the goal's."""

    # In m, in the frame of the goal: robot, its handle, a point round the goal, the goal's handle,
    # run-in.
    points: tuple[tuple[float, float], ...]
    bearing: float  # of the middle control point, relative to the robot's heading, in rad
    bend: float  # curvature at the start in 1/m, positive to the left
    straight: float  # path to the circle beside the goal, m
    turn: float  # angle on it, rad
    left: float  # path to the goal, m
    heading: float  # of the straight part, for a circle to the left of the goal's axis, rad
    side: float  # -1 if the circle is on the right, and all is mirrored


def _curve_to(
    rel: Pose,
    v: float,
    style: Style,
    side: float,
) -> _Curve:
    """Return the curve for a robot at `rel`, in the frame of the goal, that drives at `v` (m/s).

    Its middle control point lies ahead on the shortest path: the tangent from the robot to a circle
    beside the goal (to the left of its axis for `side` 1, to the right for -1), the circle, and the
    run-in.
    """
    ahead = style.ahead + style.per_speed * max(v, 0.0)
    behind, beyond, beside = _CORRIDOR
    x = rel.x + style.run_in
    y = side * rel.y
    in_corridor = x > behind and rel.x < beyond and abs(y) < beside
    if in_corridor:
        straight = left = max(-rel.x, 0.0)
        heading = turn = end = 0.0
        middle = rel.x + ahead, 0.0
    else:
        straight, heading, turn = _onto_circle(x, y, style.radius)
        left = straight + style.radius * turn + style.run_in
        end = -style.run_in
        dx, dy = _ahead(straight, heading, turn, style.radius, ahead)
        middle = rel.x + dx, rel.y + side * dy
    dx = middle[0] - rel.x
    dy = middle[1] - rel.y
    distance = math.hypot(dx, dy)
    bearing = wrap_angle(math.atan2(dy, dx) - rel.yaw)
    angle = math.copysign(min(abs(bearing), _STRAIGHT_BEHIND), bearing)
    # With this handle the curve begins as the arc to a middle control point ahead; it is 0 for one
    # behind.
    handle = math.sqrt(0.375) * distance * math.cos(angle / 2.0)
    bend = 0.75 * distance * math.sin(angle) / handle**2
    points = (
        (rel.x, rel.y),
        (rel.x + handle * math.cos(rel.yaw), rel.y + handle * math.sin(rel.yaw)),
        middle,
        (end - style.radius / 2.0, 0.0),
        (end, 0.0),
    )
    return _Curve(points, bearing, bend, straight, turn, left, heading, side)


def _onto_circle(
    x: float,
    y: float,
    radius: float,
) -> tuple[float, float, float]:
    """Return the tangent from (x, y) to a circle: its length (m) and heading (rad), then the angle.

    The angle (rad) is driven on the circle. The circle touches the axis at the origin from the left
    and is driven counter-clockwise.
    """
    distance = math.hypot(x, radius - y)
    direction = math.atan2(radius - y, -x)
    if distance >= radius:
        straight = math.sqrt(distance**2 - radius**2)
        heading = direction - math.asin(radius / distance)
    else:  # from inside the circle the path leads out
        straight = 0.0
        heading = direction - math.pi / 2 - 2.0 * (1.0 - distance / radius)
    turn = -heading % (2.0 * math.pi)
    return straight, heading, turn if turn < 2.0 * math.pi - 0.02 else 0.0


def _ahead(
    straight: float, heading: float, turn: float, radius: float, distance: float
) -> tuple[float, float]:
    """Return the displacement (m) in the goal's frame after a distance (m) on the shortest path."""
    first = min(straight, distance)
    angle = min((distance - first) / radius, turn)
    last = distance - first - angle * radius
    end = heading + angle
    arc_x = radius * (math.sin(end) - math.sin(heading))
    arc_y = radius * (math.cos(end) - math.cos(heading))
    dx = first * math.cos(heading) + arc_x + last * math.cos(end)
    dy = first * math.sin(heading) - arc_y + last * math.sin(end)
    return dx, dy


def _passing_distance(curve: _Curve, x: float, y: float) -> float:
    """Return the least distance in m of the straight part of the shortest path from (x, y) m."""
    start_x, start_y = curve.points[0]
    c = math.cos(curve.heading)
    s = curve.side * math.sin(curve.heading)
    projected = (x - start_x) * c + (y - start_y) * s
    along = max(0.0, min(curve.straight, projected))
    return math.hypot(x - start_x - along * c, y - start_y - along * s)


def _shortest_path(curve: _Curve, radius: float, goal: Pose) -> FloatArray:
    """Return places on the shortest path that a curve approximates, shape (n, 2), in m."""
    x, y = curve.points[0]
    parts = curve.straight, curve.heading, curve.turn, radius
    steps = range(math.ceil(curve.left / _STEP))
    places = [_ahead(*parts, _STEP * step) for step in steps]
    local = np.reshape(places, (-1, 2)) * (1.0, curve.side) + (x, y)
    return _placed(local, goal)


def _sampled(curve: _Curve, goal: Pose) -> FloatArray:
    """Return poses on a curve to `goal`, and `goal` itself, shape (n, 3): x, y in m, yaw in rad."""
    t = np.linspace(0.0, 1.0, _SAMPLES)[:, None]
    shares = [math.comb(4, k) * t**k * (1.0 - t) ** (4 - k) for k in range(5)]
    local = sum(share * np.array(point) for share, point in zip(shares, curve.points, strict=True))
    places = _placed(np.vstack([local, (0.0, 0.0)]), goal)
    steps = np.diff(places, axis=0)
    yaws = np.append(np.arctan2(steps[:, 1], steps[:, 0]), goal.yaw)
    return np.column_stack([places, yaws])


def _placed(local: FloatArray, goal: Pose) -> FloatArray:
    """Transform places in m, shape (n, 2), from the frame of a goal to the frame of its pose."""
    c = math.cos(goal.yaw)
    s = math.sin(goal.yaw)
    rotation = np.array([[c, s], [-s, c]])
    return np.asarray(local @ rotation + (goal.x, goal.y))


_LATERAL = 0.04  # m from the goal's axis at which a goal is reached
_HEADING = 0.1  # rad from its heading
_SHORT = 0.015  # m before a goal at which a robot may stand
_PAST = 0.06  # m behind it
_PARKED = Standstill(0.03)  # at its goal a robot may creep: on curves it does not stop at once
_CREEP = 0.04  # m/s
_SIDE_HYSTERESIS = 0.3  # s by which the path on the other side must be faster to be preferred
_PER_DEPTH = 20.0  # s per m that a path leads into a wall: more than any path round it takes
_HANDLES = (1.0, 0.25, 2.0)  # ratios of the handles' lengths to those of the style, by preference
_BESIDE = 0.03  # m between the robot's side and a ball that it passes
_RESERVE = 1.2  # ratio of the greatest deceleration to the planned one
_TO_ROTATE = 0.6  # s in which the greatest rotational velocity is reached
# rad on the circle below which it is driven faster, as rotation needs time to build up
_SLIGHT = 0.3


class Driver:
    """Drives a robot to a pose along a Bezier curve that is recomputed at every tick.

    Parameters
    ----------
    limits : Limits
        Limits of the base, or those with the ball.
    style : Style
        How the curve is driven.
    start : RobotState
        State at the start.
    robot : Robot, optional
        The driver keeps clear of the walls in the scene of this robot; by default of none.
    ball : ObjectState, optional
        The driver keeps clear of this ball until the run-in.
    """

    def __init__(
        self,
        limits: Limits,
        style: Style,
        start: RobotState,
        robot: Robot | None = None,
        ball: ObjectState | None = None,
    ) -> None:
        self._limits = limits
        self._style = style
        self._robot = robot
        self._ball = ball
        self._rotation = min(style.rotation, limits.w, _TO_ROTATE * limits.aw)  # rad/s
        self._braking = min(style.braking, limits.brake / _RESERVE)  # m/s^2
        self._last = Command(start.vx, start.w)
        self._side = 0.0
        self._laid: tuple[_Curve, Pose] | None = None

    def path(self) -> FloatArray | None:
        """Return the curve of the last tick as poses; see `Action.path`."""
        return None if self._laid is None else _sampled(*self._laid)

    def _curve(self, pose: Pose, target: Pose, v: float) -> _Curve:
        """Return the faster of the two curves to `target`.

        The time of a path through a wall or the ball is longer by its depth.
        """
        if self._side == 0.0:
            self._style = self._fitting(pose, target, v)
        curves = self._curves(pose, target, v, self._style)
        times = {}
        for side, curve in curves.items():
            depth = self._depth(curve, self._style, pose, target)
            times[side] = self._time(curve) + _PER_DEPTH * depth
        if self._side == 0.0 or times[-self._side] < times[self._side] - _SIDE_HYSTERESIS:
            self._side = min(times, key=times.__getitem__)
        return curves[self._side]

    def _curves(
        self,
        pose: Pose,
        target: Pose,
        v: float,
        style: Style,
    ) -> dict[float, _Curve]:
        """Return both curves to `target`, by the side of the goal's axis with their circle."""
        rel = target.relative(pose)
        return {side: _curve_to(rel, v, style, side) for side in (1.0, -1.0)}

    def _fitting(self, pose: Pose, target: Pose, v: float) -> Style:
        """Return the style, with other handles if both paths lead through a wall or the ball."""
        styles = [replace(self._style, radius=share * self._style.radius) for share in _HANDLES]

        def least_depth(style: Style) -> float:
            curves = self._curves(pose, target, v, style).values()
            return min(self._depth(curve, style, pose, target) for curve in curves)

        return min(styles, key=least_depth)

    def _time(self, curve: _Curve) -> float:
        """Return an estimate of a curve's duration in s: its straight part and its two turns."""
        turned = abs(curve.bearing) + curve.turn
        return curve.straight / self._limits.v + turned / self._rotation

    def _depth(
        self,
        curve: _Curve,
        style: Style,
        pose: Pose,
        target: Pose,
    ) -> float:
        """Return by how much in m the robot may reach into a wall or the ball on a curve."""
        if self._robot is None:
            return 0.0
        into_ball = 0.0
        if self._ball is not None:
            ball = target.relative(Pose(self._ball.x, self._ball.y, 0.0))
            room = self._robot.half_width + self._robot.scene.radius(BALL) + _BESIDE
            now = math.hypot(self._ball.x - pose.x, self._ball.y - pose.y)
            into_ball = max(0.0, min(room, now) - _passing_distance(curve, ball.x, ball.y))
        middle = self._robot.scene.area.x
        around_target = abs(target.x - middle) + style.run_in + 2.0 * style.radius
        farthest = max(abs(pose.x - middle), around_target)
        if farthest <= nearest_to_walls(self._robot):
            return into_ball
        path = _shortest_path(curve, style.radius, target)
        return max(into_ball, depth_in_walls(path, self._robot))

    def follow(self, state: RobotState, target: Pose, end_speed: float) -> Command:
        """Return the command for the next tick to `target`, to be passed at `end_speed` (m/s)."""
        curve = self._curve(state.pose, target, state.vx)
        self._laid = curve, target
        bend = max(-self._style.sharpest, min(self._style.sharpest, curve.bend))
        v = self._speed(curve, bend, state.vx, end_speed)
        if end_speed == 0.0 and not _standing_pose(target.relative(state.pose)):
            v = max(v, _CREEP)
        return self.command(v, bend)

    def _speed(
        self,
        curve: _Curve,
        bend: float,
        v: float,
        end_speed: float,
    ) -> float:
        """Return the greatest speed in m/s here from which the rest of the curve can be driven."""
        left = max(curve.left - v * CONTROL_PERIOD, 0.0)
        here = self._rotation / max(abs(bend), 1e-6)
        share = max(min(curve.turn / _SLIGHT, 1.0), 0.05)
        circle = self._rotation * self._style.radius / share
        before_end = math.sqrt(end_speed**2 + 2.0 * self._braking * left)
        before_circle = math.sqrt(circle**2 + 2.0 * self._braking * curve.straight)
        return min(self._limits.v, here, before_end, before_circle)

    def command(self, v: float, bend: float) -> Command:
        """Return the command nearest to v (m/s) on a curve (1/m) that the base can follow."""
        last = self._last
        most = self._rotation
        braking = _RESERVE * self._braking
        slowest = last.vx - braking * CONTROL_PERIOD
        fastest = last.vx + self._limits.a * CONTROL_PERIOD
        v = max(slowest, min(fastest, v))
        return self.send(v, max(-most, min(most, max(v, 0.0) * bend)))

    def turn(self, angle: float) -> Command:
        """Return the command that stops, and turns by an angle (rad)."""
        last = self._last
        limits = self._limits
        most = self._rotation
        slowest = last.vx - limits.brake * CONTROL_PERIOD
        fastest = last.vx + limits.a * CONTROL_PERIOD
        v = max(slowest, min(fastest, 0.0))
        w = max(-most, min(most, 3.0 * angle))
        return self.send(v, w if abs(v) < 0.2 else last.w)

    def send(self, v: float, w: float) -> Command:
        """Return the command of v (m/s) and of the turn rate (rad/s) that is nearest to w."""
        step = self._limits.aw * CONTROL_PERIOD
        last = self._last.w
        self._last = Command(v, max(last - step, min(last + step, w)))
        return self._last


def reached(rel: Pose, v: float, end_speed: float) -> bool:
    """Return whether a robot stands at its goal, or passes it if `end_speed` (m/s) is positive.

    `rel` is its pose in the goal's frame, v its speed in m/s.
    """
    if end_speed > 0.0:
        at_goal = abs(rel.y) <= _LATERAL and abs(rel.yaw) <= _HEADING
        return at_goal and -v * CONTROL_PERIOD / 2 <= rel.x < 0.1
    return _standing_pose(rel) and _PARKED.holds(v)


def _standing_pose(rel: Pose) -> bool:
    """Return whether the goal is reached at `rel`, in its frame."""
    return _standing_place(rel) and abs(rel.yaw) <= _HEADING


def _standing_place(rel: Pose) -> bool:
    """Return whether the goal's position is reached at `rel`, in its frame, with any heading."""
    return abs(rel.y) < _LATERAL and -_SHORT < rel.x < _PAST


_TO_POSE = Style(
    radius=0.3,
    run_in=0.05,
    ahead=0.12,
    per_speed=0.25,
    sharpest=60.0,
    rotation=2.2,
    braking=0.6,
)
_TO_BALL = Style(
    radius=0.25,
    run_in=0.3,
    ahead=0.12,
    per_speed=0.25,
    sharpest=60.0,
    rotation=2.0,
    braking=0.6,
)
_DRIBBLING = Style(
    radius=0.1,  # the least on which the ball is led
    run_in=0.05,
    ahead=0.05,
    per_speed=0.15,
    sharpest=1.2 / 0.1,
    rotation=0.5,
    braking=0.36,
)
_TO_SHOT = Style(
    radius=0.12,
    run_in=0.05,
    ahead=0.05,
    per_speed=0.15,
    sharpest=1.2 / 0.12,
    rotation=0.6,
    braking=0.36,
)

# m between the ball and the hold of a robot at the goal, up to which the goal is the ball
_AT_BALL = 0.2
_BACKING = 0.3  # m/s at which the robot backs off from a ball in its front
_STRAIGHTENING = 0.5  # rad that a robot may turn on the spot with the ball between its fins


class _BezierAction(Action):
    """An action that follows a curve."""

    _driver: Driver
    _goal: Goal
    _target: Pose

    def path(self) -> FloatArray | None:
        """Return the curve of the last tick; see `Action.path`."""
        return self._driver.path()

    def _approach(self, state: RobotState, message: str, most: float) -> Step:
        """Follow the curve; at the goal's position, turn if it is by at most `most` rad."""
        rel = self._target.relative(state.pose)
        speed = self._goal.speed
        if speed == 0.0 and _standing_place(rel) and abs(rel.yaw) <= most:
            turning = self._driver.turn(-rel.yaw)
            return Step(turning, Status.RUNNING, "turning into the goal's heading")
        command = self._driver.follow(state, self._target, speed)
        return Step(command, Status.RUNNING, message)


class BezierGoToPose(_BezierAction):
    """Drive to a pose; arrive at a ball without moving it.

    Forward only, except to back off from a ball in front that is not at the goal. A goal with a
    speed is passed at that speed; one that was missed is approached again.
    """

    name: ClassVar[str] = "goToPose"

    def start(self, world: World, goal: Goal) -> None:
        """Commit to `goal`; see `Action.start`."""
        check_arrival(goal, self.robot.greatest_speed(), self.name)
        self._goal = goal
        self._target = goal.robot_pose(self.robot)
        ball = ball_of(world)
        front = self.robot.hold_point(self._target)
        self._to_ball = False
        if ball is not None:
            self._to_ball = math.hypot(ball.x - front.x, ball.y - front.y) < _AT_BALL
        self._is_backing_off = not self._to_ball and is_at_front(world, self.robot, BALL)
        style = _TO_BALL if self._to_ball else _TO_POSE
        beside = ball if self._to_ball or self._is_backing_off else None
        self._driver = Driver(
            differential(self.robot).limits,
            style,
            world.robot,
            self.robot,
            beside,
        )

    def step(self, world: World) -> Step:
        """Return the next command; see `Action.step`."""
        state = world.robot
        speed = self._goal.speed
        rel = self._target.relative(state.pose)
        if reached(rel, state.vx, speed):
            command = self._driver.send(speed, 0.0) if speed > 0.0 else STOP
            return finished(Status.SUCCEEDED, "arrived at the goal", command)
        if self._is_backing_off:  # until it cannot touch the ball when it turns
            ball = ball_of(world)
            x, y, _ = state.pose
            clear = ball_clearance(self.robot)
            self._is_backing_off = ball is not None and math.hypot(ball.x - x, ball.y - y) < clear
        if self._is_backing_off:
            backing = self._driver.command(-_BACKING, 0.0)
            return Step(backing, Status.RUNNING, "backing off from the ball")
        most = _STRAIGHTENING if self._to_ball else math.pi
        return self._approach(state, "following the curve to the goal", most)


# Distances in m of the ball before the hold. A ball beyond the first would slip out in a turn; so
# the robot first drives straight ahead, until the ball is within the second.
_LOOSE = 0.025
_TAKEN = 0.01
_TAKING = 0.3  # m/s of that drive
_TURNING = 0.3  # rad that the robot may turn on the spot with the ball, once it is at the goal


class _BezierHolding(_BezierAction):
    """An action that follows a curve with the ball in front."""

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot)
        self._limits = differential(robot).holder_for(self.name).limits


class BezierDribbleBall(_BezierHolding):
    """Push the ball to a pose: turn slowly, and brake no harder than the ball does.

    A goal with a speed is passed at that speed; one that was missed is approached again in a loop.
    """

    name: ClassVar[str] = "dribbleBall"

    def start(self, world: World, goal: Goal) -> None:
        """Commit to `goal`; see `Action.start`."""
        check_arrival(goal, self._limits.v, self.name)
        check_held(world, self.robot, self.name)
        self._goal = goal
        self._target = goal.robot_pose(self.robot)
        self._driver = Driver(self._limits, _DRIBBLING, world.robot)
        self._is_taking_in = self._gap(world) > _LOOSE

    def step(self, world: World) -> Step:
        """Return the next command; see `Action.step`."""
        if lost := lost_ball(world, self.robot):
            return finished(Status.FAILED, lost)
        state = world.robot
        speed = self._goal.speed
        rel = self._target.relative(state.pose)
        if reached(rel, state.vx, speed):
            command = self._driver.command(speed, 0.0)
            return finished(Status.SUCCEEDED, "arrived at the goal with the ball", command)
        self._is_taking_in = self._is_taking_in and self._gap(world) > _TAKEN
        if self._is_taking_in:
            return Step(self._driver.command(_TAKING, 0.0), Status.RUNNING, "taking the ball in")
        return self._approach(state, "dribbling along the curve to the goal", _TURNING)

    def _gap(self, world: World) -> float:
        """Return the distance in m of the ball before the hold, along the robot's heading."""
        ball = world.objects[BALL]
        pose = world.robot.pose
        return self.robot.hold_point(pose).relative(Pose(ball.x, ball.y, 0.0)).x


_POST_ROOM = 0.2  # m between a goalpost and the path of the ball
_ROLL_RESERVE = 0.25  # m that the ball could roll on behind the line
_SLANT = 0.9  # rad: greatest angle between the end of the curve and the goal's axis
_BEFORE_LINE = 0.35  # m between ball and line at the end of the curve
_LINE = 0.02  # m behind the line at which the ball is in the goal
_BEND = 4.0  # 1/m: greatest curvature of a run-up
_SHOT_OVER = Standstill(0.05)  # below this, ball and robot are too slow to score


class BezierShoot(_BezierHolding):
    """Send the ball into a goal by motion alone.

    The goal's position is in the mouth of one of the field's goals; its heading and speed do not
    count.
    """

    name: ClassVar[str] = "shoot"

    def start(self, world: World, goal: Goal) -> None:
        """Commit to the goal mouth that `goal` lies in; see `Action.start`.

        Raises ActionError if the field has no goals, or `goal` lies in none.
        """
        check_arrival(goal, self.robot.greatest_speed(), self.name)
        check_held(world, self.robot, self.name)
        field = field_of(self.robot)
        x = goal.pose.x
        y = goal.pose.y
        if field.goal_width <= 0.0:
            raise ActionError("shoot: expected a scene with goals, it has no bays")
        side = field.side_of(x)
        line, middle = field.goal_center(side)
        if abs(x - line) > 0.5 * field.goal_depth or abs(y - middle) > field.goal_width / 2:
            raise ActionError(
                f"shoot: expected a position in a goal's mouth, got ({x:.2f}, {y:.2f}) m"
            )
        self._side = side
        share = max(-1.0, min(1.0, (y - middle) / (field.goal_width / 2)))
        self._middle = share * self._half_mouth()
        self._driver = Driver(self._limits, _TO_SHOT, world.robot)
        self._released = False

    def _half_mouth(self) -> float:
        """Return half the width in m of the mouth in which the ball keeps clear of the posts."""
        return field_of(self.robot).goal_width / 2 - self.robot.scene.radius(BALL) - _POST_ROOM

    def step(self, world: World) -> Step:
        """Return the next command; see `Action.step`."""
        ball = ball_of(world)
        if ball is None:
            return finished(Status.FAILED, "lost the ball: its position is unknown")
        field = field_of(self.robot)
        mouth = Pose(*field.goal_center(self._side), 0.0)
        if is_in_goal(ball, mouth, field, _LINE):
            return finished(Status.SUCCEEDED, "the ball is in the goal", STOP)
        if self._released:
            return self._watch(world, ball)
        if lost := lost_ball(world, self.robot):
            return finished(Status.FAILED, lost)
        crossing = self._crossing(world.robot.pose)
        if crossing is None or abs(crossing - mouth.y) > self._half_mouth():
            target = self._before_mouth(world.robot.pose)
            command = self._driver.follow(world.robot, target, self._limits.v)
            return Step(command, Status.RUNNING, "dribbling along a curve to the goal's mouth")
        return self._run_up(
            world,
            -behind_line(ball, mouth, field),
            crossing - mouth.y,
        )

    def _crossing(self, pose: Pose) -> float | None:
        """Return y (m) at which the robot crosses the goal line straight ahead; None if never."""
        hold = self.robot.hold_point(pose)
        forward = self._side * math.cos(pose.yaw)
        short = self._side * (field_of(self.robot).goal_center(self._side)[0] - hold.x)
        if forward < 0.3 or short < 0.0:
            return None
        return hold.y + short / forward * math.sin(pose.yaw)

    def _before_mouth(self, pose: Pose) -> Pose:
        """Return the pose of the axle before the mouth, with a heading toward it from here."""
        straight = 0.0 if self._side > 0 else math.pi
        line, y = field_of(self.robot).goal_center(self._side)
        hold = self.robot.hold_point(pose)
        slant = wrap_angle(math.atan2(y + self._middle - hold.y, line - hold.x) - straight)
        mouth = Pose(
            line,
            y + self._middle,
            straight + max(-_SLANT, min(_SLANT, slant)),
        )
        return mouth.ahead(-self.robot.hold - _BEFORE_LINE)

    def _run_up(self, world: World, short: float, crossing: float) -> Step:
        """Drive straight on, and brake as soon as the ball will roll into the goal.

        The ball is `short` m before the line and will cross it `crossing` m beside the middle.
        """
        state = world.robot
        forward = max(abs(math.cos(state.pose.yaw)), 0.3)
        needed = max(short, 0.0) / forward + _ROLL_RESERVE
        roll = state.vx**2 / (2.0 * self.robot.scene.objects[BALL].rolling_deceleration)
        if roll > needed and abs(state.w) < 0.3:
            self._released = True
            return Step(STOP, Status.RUNNING, "braking: the ball rolls on into the goal")
        # Steer mildly from the posts toward the middle of the mouth.
        aim = max(-0.5, min(0.5, self._side * (self._middle - crossing)))
        bend = aim / max(short + 0.5, 0.5) if abs(aim) > 0.1 else 0.0
        command = self._driver.command(self._limits.v, max(-_BEND, min(_BEND, bend)))
        return Step(command, Status.RUNNING, "running up to the shot")

    def _watch(self, world: World, ball: ObjectState) -> Step:
        """Brake, and wait until the ball has crossed the line or come to rest."""
        if _SHOT_OVER.holds(ball.speed) and _SHOT_OVER.holds(world.robot.vx):
            return finished(Status.FAILED, "missed: the ball came to rest outside the goal")
        return Step(STOP, Status.RUNNING, "waiting for the ball to roll into the goal")


_PAPER = names_of(PAPER_11)
ACTIONS = (
    ActionSpec("goToPose", BezierGoToPose, samplers.go_to_pose, _PAPER),
    ActionSpec("dribbleBall", BezierDribbleBall, samplers.dribble_ball, _PAPER),
    ActionSpec("shoot", BezierShoot, samplers.shoot, _PAPER),
)
"""The paper's action set; its models have the paper's eleven features."""
