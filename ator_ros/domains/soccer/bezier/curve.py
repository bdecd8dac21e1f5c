"""The Bezier curve from the robot's pose to a goal pose, recomputed at every tick."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ator_ros.geometry import FloatArray, Pose, wrap_angle

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
class Curve:
    """A Bezier curve of degree four that leaves in the robot's heading and arrives in the goal's.

    Attributes
    ----------
    points : tuple of 5 points
        Control points (x, y) in m, in the frame of the goal: the robot, its handle, the point that leads
        round the goal, the goal's handle, and the goal, or the beginning of the run-in to it.
    bearing : float
        Of the middle control point in rad, seen from the robot's heading.
    bend : float
        Curvature at the start in 1/m, positive to the left.
    straight, turn, left : float
        Way in m to the circle beside the goal, angle in rad on it, and way in m to the goal.
    heading, side : float
        Heading in rad of the straight part for a circle to the left of the goal's axis; -1 if the circle lies
        to its right, and all is mirrored.
    """

    points: tuple[tuple[float, float], ...]
    bearing: float
    bend: float
    straight: float
    turn: float
    left: float
    heading: float
    side: float


def curve_to(rel: Pose, v: float, shape: CurveShape, side: float) -> Curve:
    """Lay the curve to a goal.

    Its middle control point lies ahead on the shortest way: the tangent from the robot to a circle beside
    the goal, the circle, on which the goal is reached in its heading, and the run-in.

    Parameters
    ----------
    rel : Pose
        The robot in the frame of the goal.
    v : float
        Its speed in m/s.
    shape : CurveShape
        Sizes.
    side : {1.0, -1.0}
        1: the circle lies to the left of the goal's axis.
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
) -> Curve:
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
    return Curve(points, bearing, bend, *way)


def passing_distance(curve: Curve, x: float, y: float) -> float:
    """Return how near in m the straight part of the shortest way comes to (x, y) m in the goal's frame."""
    start_x, start_y = curve.points[0]
    c, s = math.cos(curve.heading), curve.side * math.sin(curve.heading)
    along = max(0.0, min(curve.straight, (x - start_x) * c + (y - start_y) * s))
    return math.hypot(x - start_x - along * c, y - start_y - along * s)


def shortest_way(curve: Curve, shape: CurveShape, goal: Pose) -> FloatArray:
    """Return places on the shortest way that a curve to `goal` approximates, shape (n, 2), in m."""
    x, y = curve.points[0]
    count = math.ceil(curve.left / _STEP)
    ahead = _STEP * np.arange(min(count, math.floor(curve.straight / _STEP) + 1))
    straight = np.column_stack([ahead * math.cos(curve.heading), ahead * math.sin(curve.heading)])
    parts = curve.straight, curve.heading, curve.turn, shape.radius
    rest = [_ahead(*parts, _STEP * step) for step in range(len(ahead), count)]
    places = np.vstack([straight, np.reshape(rest, (-1, 2))])
    return _placed(places * (1.0, curve.side) + (x, y), goal)


def sampled(curve: Curve, goal: Pose) -> FloatArray:
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
