"""Following a path: how fast now, and how much to turn."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ator_ros.actions.bezier.curve import Paths
from ator_ros.geometry import wrap_angle
from ator_ros.robot import Limits, Robot
from ator_ros.world import Command

PERIOD = 0.05
"""Control period in s for which changes of the command are limited."""

_PREVIEW_TIME = 0.15
_PREVIEW_LEAST = 0.1
_MARGIN = 0.9
_TURNING = 0.7
_BEND_WINDOW = 0.15
_PUSH_MARGIN = 0.1


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
        """Give the physics of the robot's ball."""
        return cls(robot.hold, robot.ball.rolling_deceleration)

    def braking(self, v: float, curvature: float) -> float:
        """Give the greatest deceleration in m/s^2 at v (m/s) on a curve (1/m) that keeps the ball pressed on.

        The ball needs v' - L w^2 + d cos(beta) > 0 along the robot's heading, tan(beta) = L w / v.
        """
        drift = self.hold * curvature
        return self.deceleration / math.hypot(1.0, drift) - drift * v * v * curvature - _PUSH_MARGIN

    def speed(self, curvature: float) -> float:
        """Give the greatest speed in m/s on a curve (1/m) at which the ball stays pressed on."""
        drift = self.hold * abs(curvature)
        if drift < 1e-6:
            return math.inf
        room = max(self.deceleration / math.hypot(1.0, drift) - _PUSH_MARGIN, 0.01)
        return math.sqrt(room / (drift * abs(curvature)))


def speed_now(
    path: Paths, limits: Limits, *, v: float, end_speed: float, pushing: Pushing | None = None
) -> float:
    """Give the greatest speed in m/s one tick ahead from which the rest of the path can be driven.

    Parameters
    ----------
    path : Paths
        One path; it begins at the robot.
    limits : Limits
        Speeds and accelerations to keep.
    v, end_speed : float
        Speed in m/s now, and at the end of the path.
    pushing : Pushing, optional
        The physics of the ball in front, where there is one.
    """
    lengths = path.lengths[0].tolist()
    bends, rates = _curvatures(path)
    allowed = end_speed
    profile = [allowed]
    for length, bend, rate in zip(reversed(lengths), reversed(bends), reversed(rates), strict=True):
        braking = _MARGIN * limits.a
        most = min(
            limits.v, _TURNING * limits.w / max(bend, 1e-6), math.sqrt(_TURNING * limits.aw / max(rate, 1e-6))
        )
        if pushing is not None:
            braking = max(min(braking, pushing.braking(allowed, bend)), 0.02)
            most = min(most, pushing.speed(bend))
        allowed = min(most, math.sqrt(allowed**2 + 2.0 * braking * length))
        profile.append(allowed)
    profile.reverse()
    return float(np.interp(v * PERIOD, np.concatenate([[0.0], np.cumsum(lengths)]), profile))


def _curvatures(path: Paths) -> tuple[list[float], list[float]]:
    """Give curvature (1/m) and its change along the path (1/m^2) at each segment's start, without sign."""
    lengths = path.lengths[0]
    before = np.concatenate([lengths[:1], lengths[:-1]])
    spans = np.maximum((before + lengths) / 2, 1e-3)
    bends = path.turns[0] / spans
    bends[0] = bends[1]
    rates = np.abs(np.diff(bends, prepend=bends[:1])) / np.maximum(spans, _BEND_WINDOW)
    return list(np.abs(bends).tolist()), list(rates.tolist())


def curvature_now(path: Paths, *, yaw: float, end_yaw: float, v: float, lag: float) -> float:
    """Give the curvature in 1/m that turns the robot into the path a short way ahead.

    Parameters
    ----------
    path : Paths
        One path; it begins at the robot and goes on straight behind its end.
    yaw, end_yaw : float
        The robot's heading, and the heading at the end of the path, in rad.
    v : float
        Speed in m/s.
    lag : float
        Time in s that the robot needs to stop its present rotation; so much farther ahead is looked.
    """
    preview = max(abs(v) * (_PREVIEW_TIME + lag / 2), _PREVIEW_LEAST)
    lengths, headings = path.lengths[0], path.headings[0]
    middles = np.cumsum(lengths) - lengths / 2
    relative = np.unwrap(
        np.concatenate([[yaw], headings, [headings[-1] + wrap_angle(end_yaw - headings[-1])]])
    )
    turn = (
        np.interp(preview, np.concatenate([[0.0], middles, [middles[-1] + lengths[-1] / 2]]), relative) - yaw
    )
    return float(turn) / preview


def ramped(last: Command, v: float, w: float, limits: Limits) -> Command:
    """Give the command nearest to (v, w) that keeps the limits one tick after `last`."""
    dv, dw = limits.a * PERIOD, limits.aw * PERIOD
    v = min(max(v, last.v - dv), last.v + dv)
    w = min(max(w, last.w - dw), last.w + dw)
    return Command(min(max(v, -limits.v), limits.v), min(max(w, -limits.w), limits.w))
