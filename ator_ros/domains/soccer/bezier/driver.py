"""Driving along the curve: choice of the side, speeds, and commands."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from ator_ros.actions.base import ActionError, Goal
from ator_ros.domains.soccer.bezier.curve import Curve, CurveShape, curve_to, sampled, shortest_way
from ator_ros.domains.soccer.goals import depth_in_goals, nearest_to_goals
from ator_ros.geometry import FloatArray, Pose
from ator_ros.robot.description import Limits, Robot
from ator_ros.world.state import CONTROL_PERIOD, Command, RobotState

LATERAL, HEADING = 0.04, 0.1
"""Greatest distance from the goal's axis (m) and from its heading (rad) with which a goal is reached."""

_SHORT, _PAST = 0.015, 0.06  # m before and behind a goal at which a robot may stand
_AT_REST = 0.03  # m/s
_CREEP = 0.04  # m/s
_FAITH = 0.3  # s by which the way round the other side must be quicker to be preferred
_PER_DEPTH = 20.0  # s per m of a wall in the way: any way round it is quicker than to push against it
_TIGHT = 0.25  # length of short handles over that of the style's
_RESERVE = 1.2  # greatest deceleration over the planned one
_SLIGHT = 0.3  # rad on the circle up to which it may be driven faster, as rotation needs time to build up


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
        Greatest rotational velocity in rad/s, within the limits; a curve is driven as fast as it allows.
    braking : float
        Deceleration in m/s^2 before the goal and before sharper curves.
    """

    shape: CurveShape
    sharpest: float
    rotation: float
    braking: float


class Driver:
    """Drives a robot to a pose along one Bezier curve, laid anew at every tick.

    Parameters
    ----------
    limits : Limits
        Speeds and accelerations to keep.
    style : Style
        The curve and how it is driven.
    robot : Robot, optional
        Whose scene has walls to keep clear of; by default there are none.
    """

    def __init__(self, limits: Limits, style: Style, robot: Robot | None = None) -> None:
        self._limits, self._style, self._robot = limits, style, robot
        self._rotation = min(style.rotation, limits.w)  # rad/s
        self.reset(Command())

    def reset(self, last: Command) -> None:
        """Begin anew, with `last` as the command that the robot executes."""
        self._last = last
        self._shape = self._style.shape
        self._side = 0.0
        self._laid: tuple[Curve, Pose] | None = None

    def way(self) -> FloatArray | None:
        """Return the curve of the last tick as poses; see `Action.way`."""
        return None if self._laid is None else sampled(*self._laid)

    def curve(self, pose: Pose, target: Pose, v: float) -> Curve:
        """Return the curve to `target` for a robot at `pose` that drives at v (m/s).

        Of the two that lead round the goal by the left and by the right it is the quicker; so durations are
        continuous where the side changes. A way through the wall of a goal counts as longer.
        """
        if self._side == 0.0:
            self._shape = self._fitting(pose, target, v)
        curves = self._curves(pose, target, v, self._shape)
        times = {
            side: self._time(curve) + _PER_DEPTH * self._depth(curve, self._shape, pose, target)
            for side, curve in curves.items()
        }
        if self._side == 0.0 or times[-self._side] < times[self._side] - _FAITH:
            self._side = min(times, key=times.__getitem__)
        return curves[self._side]

    def _curves(self, pose: Pose, target: Pose, v: float, shape: CurveShape) -> dict[float, Curve]:
        """Return the two curves to `target`, by the side of the goal's axis on which their circle lies."""
        rel = target.relative(pose)
        return {side: curve_to(rel, v, shape, side) for side in (1.0, -1.0)}

    def _fitting(self, pose: Pose, target: Pose, v: float) -> CurveShape:
        """Return the style's shape, with short handles where both ways lead through the wall of a goal."""
        shape = self._style.shape
        curves = self._curves(pose, target, v, shape)
        if min(self._depth(curve, shape, pose, target) for curve in curves.values()) == 0.0:
            return shape
        return replace(shape, radius=_TIGHT * shape.radius)

    def _time(self, curve: Curve) -> float:
        """Return an estimate in s of the time that a curve takes: its straight part and its two turns."""
        return curve.straight / self._limits.v + (abs(curve.bearing) + curve.turn) / self._rotation

    def _depth(self, curve: Curve, shape: CurveShape, pose: Pose, target: Pose) -> float:
        """Return by how much in m the robot may reach into the wall of a goal on the way of a curve."""
        farthest = max(abs(pose.x), abs(target.x) + shape.run_in + 2.0 * shape.radius)
        if self._robot is None or farthest <= nearest_to_goals(self._robot):
            return 0.0
        return depth_in_goals(shortest_way(curve, shape, target), self._robot)

    def follow(self, state: RobotState, target: Pose, end_speed: float) -> Command:
        """Return the command for the next tick to `target`, to be passed at `end_speed` (m/s)."""
        curve = self.curve(state.pose, target, state.v)
        self._laid = curve, target
        bend = max(-self._style.sharpest, min(self._style.sharpest, curve.bend))
        return self.command(self._speed(curve, bend, state.v, end_speed), bend)

    def _speed(self, curve: Curve, bend: float, v: float, end_speed: float) -> float:
        """Return the greatest speed in m/s here, from which the rest of the curve can be driven, too."""
        style = self._style
        left = max(curve.left - v * CONTROL_PERIOD, 0.0)
        here = self._rotation / max(abs(bend), 1e-6)
        circle = self._rotation * self._shape.radius / max(min(curve.turn / _SLIGHT, 1.0), 0.05)
        before_end = math.sqrt(end_speed**2 + 2.0 * style.braking * left)
        before_circle = math.sqrt(circle**2 + 2.0 * style.braking * curve.straight)
        most = min(self._limits.v, here, before_end, before_circle)
        return max(most, _CREEP) if end_speed == 0.0 and left > _SHORT else most

    def command(self, v: float, bend: float) -> Command:
        """Return the command nearest to v (m/s) on a curve (1/m) that the base can follow."""
        last, most = self._last, self._rotation
        braking = min(_RESERVE * self._style.braking, self._limits.brake)
        v = max(last.v - braking * CONTROL_PERIOD, min(last.v + self._limits.a * CONTROL_PERIOD, v))
        return self.send(v, max(-most, min(most, max(v, 0.0) * bend)))

    def turn(self, angle: float) -> Command:
        """Return the command that stops and turns by what is left of an angle (rad)."""
        last, limits = self._last, self._limits
        v = max(last.v - limits.brake * CONTROL_PERIOD, min(last.v + limits.a * CONTROL_PERIOD, 0.0))
        w = max(-limits.w, min(limits.w, 3.0 * angle))
        return self.send(v, w if abs(v) < 0.2 else last.w)

    def send(self, v: float, w: float) -> Command:
        """Return v (m/s) with the rotational velocity (rad/s) that is nearest to w one tick later."""
        step = self._limits.aw * CONTROL_PERIOD
        self._last = Command(v, max(self._last.w - step, min(self._last.w + step, w)))
        return self._last


def reached(rel: Pose, v: float, end_speed: float) -> bool:
    """Return whether a robot at `rel` in the goal's frame, at v (m/s), stands at or passes the goal."""
    if abs(rel.y) > LATERAL or abs(rel.yaw) > HEADING:
        return False
    if end_speed > 0.0:
        return -v * CONTROL_PERIOD / 2 <= rel.x < 0.1
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
