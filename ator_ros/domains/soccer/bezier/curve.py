"""The one Bezier curve from the robot's pose to a goal pose, as it is laid anew at every tick."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ator_ros.geometry import Pose, wrap_angle

_STRAIGHT_BEHIND = 3.1  # rad; what lies farther round is treated as if it lay here, to its own side
_SHARES = (1.0, 0.8, 0.6, 0.4, 0.2)  # of the angle on the circle, where it is looked at for walls
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
    near, far : float
        Least and greatest distance in m from the robot to the middle control point.
    per_speed : float
        Growth of the least distance in s with the robot's speed, as commands take effect late.
    """

    radius: float
    run_in: float
    near: float
    far: float
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
    bulge : tuple of points
        Points (x, y) in m of that way, in the frame of the goal.
    """

    points: tuple[tuple[float, float], ...]
    bearing: float
    bend: float
    straight: float
    turn: float
    left: float
    bulge: tuple[tuple[float, float], ...] = ()


def curve_to(rel: Pose, v: float, shape: CurveShape, side: float) -> Curve:
    """Lay the curve to a goal.

    Its middle control point lies in the direction of the tangent from the robot to a circle beside the goal
    on which the goal is reached in its heading; once on the circle, ahead on it.

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
    near = shape.near + shape.per_speed * max(v, 0.0)
    behind, beyond, beside = _CORRIDOR
    x, y = rel.x + shape.run_in, side * rel.y
    if x > behind and rel.x < beyond and abs(y) < beside:
        middle, straight, turn, left = (rel.x + near, 0.0), max(-rel.x, 0.0), 0.0, max(-rel.x, 0.0)
        bulge: tuple[tuple[float, float], ...] = ()
    else:
        straight, heading, turn = _onto_circle(x, y, shape.radius)
        dx, dy = _ahead(straight, heading, turn, shape, near)
        middle, left = (rel.x + dx, rel.y + side * dy), straight + shape.radius * turn + shape.run_in
        bulge = _bulge(turn, shape, side)
    return _through(rel, middle, shape, (straight, turn, left), bulge)


def _bulge(turn: float, shape: CurveShape, side: float) -> tuple[tuple[float, float], ...]:
    """Return points (m) on the circle from where it is entered, `turn` rad before its end, to the end."""
    angles = (turn * share for share in _SHARES)
    radius, end = shape.radius, -shape.run_in
    return tuple((end - radius * math.sin(a), side * radius * (1.0 - math.cos(a))) for a in angles)


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


def _ahead(
    straight: float, heading: float, turn: float, shape: CurveShape, near: float
) -> tuple[float, float]:
    """Return where the middle control point lies (m) from the robot, in the frame of the goal."""
    if straight >= near:
        length = min(straight, shape.far)
        return length * math.cos(heading), length * math.sin(heading)
    radius = shape.radius
    angle = min((near - straight) / radius, turn)
    beyond, end = near - straight - angle * radius, heading + angle
    dx = straight * math.cos(heading) + radius * (math.sin(end) - math.sin(heading)) + beyond * math.cos(end)
    dy = straight * math.sin(heading) - radius * (math.cos(end) - math.cos(heading)) + beyond * math.sin(end)
    return dx, dy


def _through(
    rel: Pose,
    middle: tuple[float, float],
    shape: CurveShape,
    way: tuple[float, float, float],
    bulge: tuple[tuple[float, float], ...],
) -> Curve:
    """Complete a curve by its handles; the robot's shrinks to nothing where it looks away from the curve."""
    dx, dy = middle[0] - rel.x, middle[1] - rel.y
    distance = math.hypot(dx, dy)
    bearing = wrap_angle(math.atan2(dy, dx) - rel.yaw)
    angle = math.copysign(min(abs(bearing), _STRAIGHT_BEHIND), bearing)
    # With this handle the curve begins as the arc to its middle control point, where that lies ahead.
    handle = math.sqrt(0.375) * distance * math.cos(angle / 2.0)
    bend = 0.75 * distance * math.sin(angle) / handle**2
    end = -shape.run_in if bulge else 0.0
    points = (
        (rel.x, rel.y),
        (rel.x + handle * math.cos(rel.yaw), rel.y + handle * math.sin(rel.yaw)),
        middle,
        (end - shape.radius / 2.0, 0.0),
        (end, 0.0),
    )
    return Curve(points, bearing, bend, *way, bulge)
