"""Driving along a Bezier curve that is recomputed at every tick: its shape, side, speeds, and commands."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ator_ros.domains.soccer.field import BALL, depth_in_goals, nearest_to_goals
from ator_ros.geometry import FloatArray, Pose, wrap_angle
from ator_ros.robot.description import Limits, Robot
from ator_ros.world.state import CONTROL_PERIOD, Command, ObjectState, RobotState, Standstill

_STRAIGHT_BEHIND = 3.1  # rad; what lies farther round is treated as if it lay here, to its own side
_SAMPLES = 40
_STEP = 0.05  # m between places on the shortest way
_CORRIDOR = (-0.02, 0.06, 0.05)  # m along the axis from the run-in to behind the goal, and to either side


@dataclass(frozen=True, slots=True)
class CurveShape:
    """What the control points of a curve depend on, besides the two poses.

    Attributes
    ----------
    radius : float
        Of the circle beside the goal that the curve comes in on, in m: the length of its handles.
    run_in : float
        Length of the straight line before the goal in m.
    ahead : float
        Length of the way in m from a standing robot to the middle control point.
    per_speed : float
        Growth of that length in s with the robot's speed, as commands take effect late.
    """

    radius: float
    run_in: float
    ahead: float
    per_speed: float


@dataclass(frozen=True, slots=True)
class _Curve:
    """A Bezier curve of degree four that leaves in the robot's heading and arrives in the goal's.

    The control points (m, in the frame of the goal) are the robot, its handle, the point that leads round the
    goal, the goal's handle, and the goal, or the beginning of the run-in to it.
    """

    points: tuple[tuple[float, float], ...]
    bearing: float  # of the middle control point, seen from the robot's heading, in rad
    bend: float  # curvature at the start in 1/m, positive to the left
    straight: float  # way to the circle beside the goal, m
    turn: float  # angle on it, rad
    left: float  # way to the goal, m
    heading: float  # of the straight part, for a circle to the left of the goal's axis, rad
    side: float  # -1 if the circle lies to its right, and all is mirrored


def _curve_to(rel: Pose, v: float, shape: CurveShape, side: float) -> _Curve:
    """Lay the curve for a robot at `rel`, in the frame of the goal, that drives at `v` (m/s).

    Its middle control point lies ahead on the shortest way: the tangent from the robot to a circle beside
    the goal, the circle, on which the goal is reached in its heading, and the run-in. The circle lies to the
    left of the goal's axis if `side` is 1, to the right if it is -1.
    """
    ahead = shape.ahead + shape.per_speed * max(v, 0.0)
    behind, beyond, beside = _CORRIDOR
    x, y = rel.x + shape.run_in, side * rel.y
    if x > behind and rel.x < beyond and abs(y) < beside:
        left = max(-rel.x, 0.0)
        return _through(rel, (rel.x + ahead, 0.0), shape, 0.0, (left, 0.0, left, 0.0, side))
    straight, heading, turn = _onto_circle(x, y, shape.radius)
    dx, dy = _ahead(straight, heading, turn, shape.radius, ahead)
    left = straight + shape.radius * turn + shape.run_in
    way = (straight, turn, left, heading, side)
    return _through(rel, (rel.x + dx, rel.y + side * dy), shape, -shape.run_in, way)


def _onto_circle(x: float, y: float, radius: float) -> tuple[float, float, float]:
    """Return length (m) and heading (rad) of the tangent from (x, y), and the angle (rad) left on the circle.

    The circle touches the axis at the origin from the left and is driven counter-clockwise. From inside it
    the way leads out.
    """
    distance, direction = math.hypot(x, radius - y), math.atan2(radius - y, -x)
    if distance >= radius:
        straight = math.sqrt(distance**2 - radius**2)
        heading = direction - math.asin(radius / distance)
    else:
        straight, heading = 0.0, direction - math.pi / 2 - 2.0 * (1.0 - distance / radius)
    turn = -heading % (2.0 * math.pi)
    return straight, heading, turn if turn < 2.0 * math.pi - 0.02 else 0.0


def _ahead(straight: float, heading: float, turn: float, radius: float, way: float) -> tuple[float, float]:
    """Return the displacement (m) after a `way` (m) along tangent, circle and run-in, in the goal's frame."""
    first = min(straight, way)
    angle = min((way - first) / radius, turn)
    last, end = way - first - angle * radius, heading + angle
    dx = first * math.cos(heading) + radius * (math.sin(end) - math.sin(heading)) + last * math.cos(end)
    dy = first * math.sin(heading) - radius * (math.cos(end) - math.cos(heading)) + last * math.sin(end)
    return dx, dy


def _through(
    rel: Pose, middle: tuple[float, float], shape: CurveShape, end: float, way: tuple[float, ...]
) -> _Curve:
    """Add both handles; the start handle vanishes when the robot faces away."""
    dx, dy = middle[0] - rel.x, middle[1] - rel.y
    distance = math.hypot(dx, dy)
    bearing = wrap_angle(math.atan2(dy, dx) - rel.yaw)
    angle = math.copysign(min(abs(bearing), _STRAIGHT_BEHIND), bearing)
    # With this handle the curve begins as the arc to its middle control point, where that lies ahead.
    handle = math.sqrt(0.375) * distance * math.cos(angle / 2.0)
    bend = 0.75 * distance * math.sin(angle) / handle**2
    points = (
        (rel.x, rel.y),
        (rel.x + handle * math.cos(rel.yaw), rel.y + handle * math.sin(rel.yaw)),
        middle,
        (end - shape.radius / 2.0, 0.0),
        (end, 0.0),
    )
    return _Curve(points, bearing, bend, *way)


def _passing_distance(curve: _Curve, x: float, y: float) -> float:
    """Return how near in m the straight part of the shortest way comes to (x, y) m in the goal's frame."""
    start_x, start_y = curve.points[0]
    c, s = math.cos(curve.heading), curve.side * math.sin(curve.heading)
    along = max(0.0, min(curve.straight, (x - start_x) * c + (y - start_y) * s))
    return math.hypot(x - start_x - along * c, y - start_y - along * s)


def _shortest_path(curve: _Curve, shape: CurveShape, goal: Pose) -> FloatArray:
    """Return places on the shortest way that a curve to `goal` approximates, shape (n, 2), in m."""
    x, y = curve.points[0]
    parts = curve.straight, curve.heading, curve.turn, shape.radius
    places = [_ahead(*parts, _STEP * step) for step in range(math.ceil(curve.left / _STEP))]
    return _placed(np.reshape(places, (-1, 2)) * (1.0, curve.side) + (x, y), goal)


def _sampled(curve: _Curve, goal: Pose) -> FloatArray:
    """Return poses on a curve to `goal`, and `goal` itself, shape (n, 3): x, y in m, yaw in rad."""
    t = np.linspace(0.0, 1.0, _SAMPLES)[:, None]
    shares = [math.comb(4, k) * t**k * (1.0 - t) ** (4 - k) for k in range(5)]
    local = sum(share * np.array(point) for share, point in zip(shares, curve.points, strict=True))
    local = np.vstack([local, (0.0, 0.0)])
    places = _placed(local, goal)
    steps = np.diff(places, axis=0)
    yaws = np.append(np.arctan2(steps[:, 1], steps[:, 0]), goal.yaw)
    return np.column_stack([places, yaws])


def _placed(local: FloatArray, goal: Pose) -> FloatArray:
    """Return places in m, given in the frame of `goal`, in the frame that `goal` is given in."""
    c, s = math.cos(goal.yaw), math.sin(goal.yaw)
    return np.asarray(local @ np.array([[c, s], [-s, c]]) + (goal.x, goal.y))


_LATERAL, _HEADING = 0.04, 0.1
"""Greatest distance from the goal's axis (m) and from its heading (rad) with which a goal is reached."""

_SHORT, _PAST = 0.015, 0.06  # m before and behind a goal at which a robot may stand
_PARKED = Standstill(0.03)
"""A robot that may end at its goal though it creeps: along curves it never stops at once."""
_CREEP = 0.04  # m/s
_SIDE_HYSTERESIS = 0.3  # s by which the way round the other side must be quicker to be preferred
_PER_DEPTH = 20.0  # s per m of a wall in the way: any way round it is quicker than to push against it
_HANDLES = (1.0, 0.25, 2.0)  # lengths of handles over that of the style's, by preference
_BESIDE = 0.03  # m between the robot's side and a ball that it passes
_RESERVE = 1.2  # greatest deceleration over the planned one
_TO_ROTATE = 0.6  # s in which the greatest rotational velocity is reached
_SLIGHT = 0.3  # rad on the circle up to which it may be driven faster, as rotation needs time to build up


@dataclass(frozen=True, slots=True)
class Style:
    """How an action drives along its curve.

    Attributes
    ----------
    sharpest : float
        Greatest curvature in 1/m; far above 1/wheel track is turning on the spot.
    rotation : float
        Greatest rotational velocity in rad/s, within the limits; a curve is driven as fast as it allows.
    braking : float
        Deceleration in m/s^2 before the goal and before sharper curves.
    """

    shape: CurveShape
    sharpest: float
    rotation: float
    braking: float


class Driver:
    """Drives a robot to a pose along a Bezier curve that is recomputed at every tick.

    Parameters
    ----------
    last : Command
        What the robot executes now.
    robot : Robot, optional
        Whose scene has walls to keep clear of; by default there are none.
    ball : ObjectState, optional
        A ball to leave in its place on the way to the run-in.
    """

    def __init__(
        self,
        limits: Limits,
        style: Style,
        last: Command,
        robot: Robot | None = None,
        ball: ObjectState | None = None,
    ) -> None:
        self._limits, self._style, self._robot, self._ball = limits, style, robot, ball
        self._rotation = min(style.rotation, limits.w, _TO_ROTATE * limits.aw)  # rad/s
        self._braking = min(style.braking, limits.brake / _RESERVE)  # m/s^2
        self._last, self._shape = last, style.shape
        self._side = 0.0
        self._laid: tuple[_Curve, Pose] | None = None

    def path(self) -> FloatArray | None:
        """Return the curve of the last tick as poses; see `Action.path`."""
        return None if self._laid is None else _sampled(*self._laid)

    def _curve(self, pose: Pose, target: Pose, v: float) -> _Curve:
        """Return the curve to `target` for a robot at `pose` that drives at v (m/s).

        Of the two that lead round the goal by the left and by the right it is the quicker; so durations are
        continuous where the side changes. A way through a goal's wall or the ball counts as longer.
        """
        if self._side == 0.0:
            self._shape = self._fitting(pose, target, v)
        curves = self._curves(pose, target, v, self._shape)
        times = {
            side: self._time(curve) + _PER_DEPTH * self._depth(curve, self._shape, pose, target)
            for side, curve in curves.items()
        }
        if self._side == 0.0 or times[-self._side] < times[self._side] - _SIDE_HYSTERESIS:
            self._side = min(times, key=times.__getitem__)
        return curves[self._side]

    def _curves(self, pose: Pose, target: Pose, v: float, shape: CurveShape) -> dict[float, _Curve]:
        """Return the two curves to `target`, by the side of the goal's axis on which their circle lies."""
        rel = target.relative(pose)
        return {side: _curve_to(rel, v, shape, side) for side in (1.0, -1.0)}

    def _fitting(self, pose: Pose, target: Pose, v: float) -> CurveShape:
        """Return the style's shape, with other handles where both ways lead through a wall or the ball."""
        style = self._style.shape
        shapes = [replace(style, radius=share * style.radius) for share in _HANDLES]

        def least_depth(shape: CurveShape) -> float:
            curves = self._curves(pose, target, v, shape).values()
            return min(self._depth(curve, shape, pose, target) for curve in curves)

        return min(shapes, key=least_depth)

    def _time(self, curve: _Curve) -> float:
        """Return an estimate in s of the time that a curve takes: its straight part and its two turns."""
        return curve.straight / self._limits.v + (abs(curve.bearing) + curve.turn) / self._rotation

    def _depth(self, curve: _Curve, shape: CurveShape, pose: Pose, target: Pose) -> float:
        """Return by how much in m the robot may reach into a wall or the ball on the way of a curve."""
        if self._robot is None:
            return 0.0
        into_ball = 0.0
        if self._ball is not None:
            ball = target.relative(Pose(self._ball.x, self._ball.y, 0.0))
            room = self._robot.half_width + self._robot.scene.radius(BALL) + _BESIDE
            now = math.hypot(self._ball.x - pose.x, self._ball.y - pose.y)
            into_ball = max(0.0, min(room, now) - _passing_distance(curve, ball.x, ball.y))
        middle = self._robot.scene.area.x
        farthest = max(abs(pose.x - middle), abs(target.x - middle) + shape.run_in + 2.0 * shape.radius)
        if farthest <= nearest_to_goals(self._robot):
            return into_ball
        return max(into_ball, depth_in_goals(_shortest_path(curve, shape, target), self._robot))

    def follow(self, state: RobotState, target: Pose, end_speed: float) -> Command:
        """Return the command for the next tick to `target`, to be passed at `end_speed` (m/s)."""
        curve = self._curve(state.pose, target, state.v)
        self._laid = curve, target
        bend = max(-self._style.sharpest, min(self._style.sharpest, curve.bend))
        v = self._speed(curve, bend, state.v, end_speed)
        if end_speed == 0.0 and not _standing_pose(target.relative(state.pose)):
            v = max(v, _CREEP)
        return self.command(v, bend)

    def _speed(self, curve: _Curve, bend: float, v: float, end_speed: float) -> float:
        """Return the greatest speed in m/s here, from which the rest of the curve can be driven, too."""
        left = max(curve.left - v * CONTROL_PERIOD, 0.0)
        here = self._rotation / max(abs(bend), 1e-6)
        circle = self._rotation * self._shape.radius / max(min(curve.turn / _SLIGHT, 1.0), 0.05)
        before_end = math.sqrt(end_speed**2 + 2.0 * self._braking * left)
        before_circle = math.sqrt(circle**2 + 2.0 * self._braking * curve.straight)
        return min(self._limits.v, here, before_end, before_circle)

    def command(self, v: float, bend: float) -> Command:
        """Return the command nearest to v (m/s) on a curve (1/m) that the base can follow."""
        last, most = self._last, self._rotation
        braking = _RESERVE * self._braking
        v = max(last.v - braking * CONTROL_PERIOD, min(last.v + self._limits.a * CONTROL_PERIOD, v))
        return self.send(v, max(-most, min(most, max(v, 0.0) * bend)))

    def turn(self, angle: float) -> Command:
        """Return the command that stops and turns by the rest of an angle (rad)."""
        last, limits, most = self._last, self._limits, self._rotation
        v = max(last.v - limits.brake * CONTROL_PERIOD, min(last.v + limits.a * CONTROL_PERIOD, 0.0))
        w = max(-most, min(most, 3.0 * angle))
        return self.send(v, w if abs(v) < 0.2 else last.w)

    def send(self, v: float, w: float) -> Command:
        """Return v (m/s) with the rotational velocity (rad/s) that is nearest to w one tick later."""
        step = self._limits.aw * CONTROL_PERIOD
        self._last = Command(v, max(self._last.w - step, min(self._last.w + step, w)))
        return self._last


def reached(rel: Pose, v: float, end_speed: float) -> bool:
    """Return whether a robot at `rel` in the goal's frame, at v (m/s), stands at or passes the goal."""
    if end_speed > 0.0:
        at_goal = abs(rel.y) <= _LATERAL and abs(rel.yaw) <= _HEADING
        return at_goal and -v * CONTROL_PERIOD / 2 <= rel.x < 0.1
    return _standing_pose(rel) and _PARKED.holds(v)


def _standing_pose(rel: Pose) -> bool:
    """Return whether `rel`, in the goal's frame, is a pose to stand in at the goal."""
    return _standing_place(rel) and abs(rel.yaw) <= _HEADING


def _standing_place(rel: Pose) -> bool:
    """Return whether `rel`, in the goal's frame, is a place to stand at the goal, whatever the heading."""
    return abs(rel.y) < _LATERAL and -_SHORT < rel.x < _PAST


def straightens(rel: Pose, end_speed: float, most: float) -> bool:
    """Return whether a robot at `rel` has only to turn, by at most `most` rad, to stand in the goal."""
    return end_speed == 0.0 and _standing_place(rel) and abs(rel.yaw) <= most
