"""Driving along the curve: choice of the side, speeds, and commands."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ator_ros.actions.base import ActionError, Goal
from ator_ros.domains.soccer.ball import BALL
from ator_ros.domains.soccer.bezier.curve import Curve, CurveShape, curve_to
from ator_ros.domains.soccer.field import Field
from ator_ros.geometry import Pose
from ator_ros.robot.description import Limits, Robot
from ator_ros.world.state import Command, RobotState

PERIOD = 0.05
"""Control period in s for which changes of the command are limited."""

LATERAL, HEADING = 0.04, 0.1
"""Greatest distance from the goal's axis (m) and from its heading (rad) with which a goal is reached."""

_SHORT, _PAST = 0.015, 0.06  # m before and behind a goal at which a robot may stand
_AT_REST = 0.03  # m/s
_CREEP = 0.05  # m/s
_FAITH = 0.3  # m by which the way round the other side must be shorter to be preferred
_SLIGHT = 0.3  # rad on the circle up to which it may be driven faster, as rotation needs time to build up
_PUSH_MARGIN = 0.1  # m/s^2
_SLOWEST_PUSH = 0.3  # m/s
_WALL = 5.0  # cost in m of way per m of depth at a goal
_AT_POSTS, _AT_MOUTH = 0.5, 0.6  # m from a goal's posts, or with the ball from its mouth, where that begins


@dataclass(frozen=True, slots=True)
class Style:
    """How an action drives along its curve.

    Attributes
    ----------
    shape : CurveShape
        Of the curve.
    sharpest : float
        Greatest curvature in 1/m; far above 1/wheel track is turning on the spot.
    rotation : float
        Share of the greatest rotational velocity that is used on a wide curve.
    braking : float
        Deceleration in m/s^2 before the goal and before sharper curves.
    turn_cost : float
        Length of way in m that a first turn by one rad is worth when a side is chosen.
    """

    shape: CurveShape
    sharpest: float
    rotation: float
    braking: float
    turn_cost: float


@dataclass(frozen=True, slots=True)
class Pushing:
    """The physics of a ball that lies against the front and is only pushed, never pulled.

    Attributes
    ----------
    hold : float
        Distance in m from the axle to the ball's centre.
    deceleration : float
        What friction does to a ball that rolls freely, in m/s^2.
    """

    hold: float
    deceleration: float

    @classmethod
    def of(cls, robot: Robot) -> Pushing:
        """Return the physics of the robot's ball."""
        return cls(robot.hold, robot.scene.objects[BALL].rolling_deceleration)

    def braking(self, v: float, curvature: float) -> float:
        """Return the greatest deceleration in m/s^2 at v (m/s) on a curve (1/m) with the ball pressed on.

        The ball needs v' - L w^2 + d cos(beta) > 0 along the robot's heading, tan(beta) = L w / v.
        """
        drift = self.hold * curvature
        return self.deceleration / math.hypot(1.0, drift) - drift * v * v * curvature - _PUSH_MARGIN

    def speed(self, curvature: float) -> float:
        """Return the greatest speed in m/s on a curve (1/m) at which the ball stays pressed on."""
        drift = self.hold * abs(curvature)
        if drift < 1e-6:
            return math.inf
        room = max(self.deceleration / math.hypot(1.0, drift) - _PUSH_MARGIN, 0.01)
        return math.sqrt(room / (drift * abs(curvature)))


class Driver:
    """Drives a robot to a pose along one Bezier curve, laid anew at every tick.

    Parameters
    ----------
    limits : Limits
        Speeds and accelerations to keep.
    style : Style
        The curve and how it is driven.
    pushing : Pushing, optional
        The physics of the ball in front, where there is one.
    field : Field, optional
        The field with the goals not to be driven into.
    """

    def __init__(
        self, limits: Limits, style: Style, pushing: Pushing | None = None, field: Field | None = None
    ) -> None:
        self._limits, self._style, self._pushing, self._field = limits, style, pushing, field
        self.reset(Command())

    def reset(self, last: Command) -> None:
        """Begin anew, with `last` as the command that the robot executes."""
        self._last = last
        self._side = 0.0

    def curve(self, pose: Pose, target: Pose, v: float) -> Curve:
        """Return the curve to `target` for a robot at `pose` that drives at v (m/s).

        Of the two that lead round the goal by the left and by the right it is the shorter; so durations are
        continuous where the side changes.
        """
        rel, shape = target.relative(pose), self._style.shape
        curves = {side: curve_to(rel, v, shape, side) for side in (1.0, -1.0)}
        costs = {side: self._cost(curve, target) for side, curve in curves.items()}
        if self._side == 0.0 or costs[-self._side] < costs[self._side] - _FAITH:
            self._side = min(costs, key=costs.__getitem__)
        return curves[self._side]

    def _cost(self, curve: Curve, target: Pose) -> float:
        """Return what a curve costs as length of way in m: its own, that of the first turn, and walls."""
        cost = curve.left + self._style.turn_cost * abs(curve.bearing)
        if self._field is None:
            return cost
        points = (target.compose(Pose(x, y, 0.0)) for x, y in curve.bulge)
        mouth = self._pushing is not None  # a ball that is pushed into a goal does not come out again
        return cost + _WALL * sum(_depth_at_goal(point, self._field, mouth=mouth) for point in points)

    def follow(self, state: RobotState, target: Pose, end_speed: float) -> Command:
        """Return the command for the next tick to `target`, to be passed at `end_speed` (m/s)."""
        curve = self.curve(state.pose, target, state.v)
        bend = max(-self._style.sharpest, min(self._style.sharpest, curve.bend))
        return self.command(self._speed(curve, bend, state.v, end_speed), bend)

    def _speed(self, curve: Curve, bend: float, v: float, end_speed: float) -> float:
        """Return the greatest speed in m/s here, from which the rest of the curve can be driven, too."""
        style = self._style
        left = max(curve.left - v * PERIOD, 0.0)
        circle = self._most(1.0 / style.shape.radius) / max(min(curve.turn / _SLIGHT, 1.0), 0.05)
        before_end = math.sqrt(end_speed**2 + 2.0 * style.braking * left)
        before_circle = math.sqrt(circle**2 + 2.0 * style.braking * curve.straight)
        most = min(self._limits.v, self._most(abs(bend)), before_end, before_circle)
        if self._pushing is not None and left > 0.15:
            return max(most, _SLOWEST_PUSH)
        return max(most, _CREEP) if end_speed == 0.0 and left > _SHORT else most

    def _most(self, bend: float) -> float:
        """Return the greatest speed in m/s on a curve (1/m, not negative)."""
        share = (
            min(self._style.rotation + bend / 60.0, 1.0) if self._pushing is None else self._style.rotation
        )
        turning = share * self._limits.w / max(bend, 1e-6)
        return turning if self._pushing is None else min(turning, self._pushing.speed(bend))

    def command(self, v: float, bend: float) -> Command:
        """Return the command nearest to v (m/s) on a curve (1/m) that the base, and the ball, can follow."""
        last, limits = self._last, self._limits
        braking = limits.brake
        if self._pushing is not None:
            pressed = self._pushing.braking(abs(last.v), abs(last.w) / max(abs(last.v), 0.05))
            braking = min(max(pressed, 0.0), braking)
        v = max(last.v - braking * PERIOD, min(last.v + limits.a * PERIOD, v))
        w = max(-limits.w, min(limits.w, max(v, 0.0) * bend))
        return self.send(v, w)

    def turn(self, angle: float) -> Command:
        """Return the command that stops and turns by what is left of an angle (rad)."""
        last, limits = self._last, self._limits
        v = max(last.v - limits.brake * PERIOD, min(last.v + limits.a * PERIOD, 0.0))
        w = max(-limits.w, min(limits.w, 3.0 * angle))
        return self.send(v, w if abs(v) < 0.2 else last.w)

    def send(self, v: float, w: float) -> Command:
        """Return v (m/s) with the rotational velocity (rad/s) that is nearest to w one tick later."""
        step = self._limits.aw * PERIOD
        self._last = Command(v, max(self._last.w - step, min(self._last.w + step, w)))
        return self._last


def _depth_at_goal(point: Pose, field: Field, *, mouth: bool) -> float:
    """Return how far in m a point is within reach of a goal's posts, or of its `mouth`, too; 0 outside."""
    reach, beyond_post = _AT_MOUTH if mouth else _AT_POSTS, abs(point.y) - field.goal_width / 2
    before = abs(point.x) - field.length / 2 + reach
    beside = reach - (beyond_post if mouth else abs(beyond_post))
    return max(min(before, beside), 0.0)


def reached(rel: Pose, v: float, end_speed: float) -> bool:
    """Return whether a robot at `rel` in the goal's frame, at v (m/s), stands at or passes the goal."""
    if abs(rel.y) > LATERAL or abs(rel.yaw) > HEADING:
        return False
    if end_speed > 0.0:
        return -v * PERIOD / 2 <= rel.x < 0.1
    return standing_place(rel) and abs(v) < _AT_REST


def standing_place(rel: Pose) -> bool:
    """Return whether `rel`, in the goal's frame, is a place to stand at the goal, whatever the heading."""
    return abs(rel.y) < LATERAL and -_SHORT < rel.x < _PAST


def check_goal(goal: Goal, most: float, name: str) -> None:
    """Check a goal.

    Raises
    ------
    ActionError
        The goal is not finite, or its speed is not in [0, most] m/s.
    """
    if not all(math.isfinite(value) for value in (*goal.pose, goal.speed)):
        raise ActionError(f"{name}: expected a finite goal, got {goal}")
    if not 0.0 <= goal.speed <= most:
        raise ActionError(f"{name}: expected a goal speed from 0 to {most:g} m/s, got {goal.speed:g} m/s")
