"""The fastest straight motion of an omnidirectional base, which turns while it drives.

Translation and rotation are independent and start together. The velocity changes at the greatest
acceleration, is constant, and changes again (bang-bang). If the base already moves, or arrives in
motion, the two components of the translation share the acceleration so that both end at the same
time, as robot soccer teams do (Purwin and D'Andrea 2006): the shares are found by bisection.

The limits of a translation are the least ones in its direction for all headings of the turn. A base
that is not alike in all directions may instead turn at both ends of a drive between standstills,
and keep one heading in between: that of its start or goal, along its way or against it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ator_ros.bases.differential.durations import (
    Rates,
    change_distance,
    drive_parts,
    drive_time,
)
from ator_ros.bases.direct import HOLD, SPEEDG, VY, XG, YAW, YAWG, YG, V, W, X, Y, wrapped
from ator_ros.bases.omni.omni_limits import OmniLimits, PlanarRates, least_extent
from ator_ros.compiled import compiled
from ator_ros.geometry import FloatArray, Pose, wrap_angle
from ator_ros.world.state import RobotState

_BISECTIONS = 30  # of a share of the acceleration: times of both components agree to 1 ns
_SLOWINGS = 24  # bisections of the share of the limits at which a drive takes as long as its turn
_LEAST_SHARE = 0.02  # of the limits: a robot that has to turn that long arrives before it is turned
_MOST_LATE = 1.1  # times the turn, that a slower drive may take
# m/s and rad/s up to which a start counts as a standstill: a robot that just arrived still rolls
_SLOW = 0.1
_SLOW_TURN = 0.2
_BETTER = 1e-6  # s that a heading of its own must gain
_STRAIGHT = 1e-6  # m/s: lateral speed up to which a motion is straight

Axis = tuple[float, float, float]
"""A motion along one axis: distance, velocity before and after it."""


class PlanarLeg(NamedTuple):
    """A motion from a start to a goal.

    x, y (m) are those of the goal relative to the start, the velocities (m/s) those at both ends,
    all in the frame of the world. `yaw` (rad) and `w` (rad/s) are those at the start, `turn` (rad)
    is the heading of the goal relative to it.
    """

    x: float
    y: float
    vx: float
    vy: float
    end_vx: float
    end_vy: float
    yaw: float
    w: float
    turn: float


@compiled
def _axis_rates(v: float, a: float, brake: float, share: float, axis: Axis) -> Rates:
    """Return a share of the limits, with a speed limit that allows the speeds at both ends."""
    fastest = max(share * v, abs(axis[1]), abs(axis[2]))
    return Rates(fastest, 1.0, share * a, share * brake, 1.0)


@compiled
def _translation(along: Axis, across: Axis, on: Rates, beside: Rates) -> tuple[float, float]:
    """Return the time in s of a translation, and the angle whose cosine and sine are the shares.

    `along` and `across` are the motions along the straight line and across, with the limits `on`
    and `beside`.
    """
    low = 0.0
    high = 0.5 * math.pi
    if abs(across[1]) < _STRAIGHT and abs(across[2]) < _STRAIGHT:
        rates = _axis_rates(on.v, on.a, on.brake, 1.0, along)
        return drive_time(along[0], along[1], along[2], rates), 0.0
    longest = 0.0
    for _ in range(_BISECTIONS):
        angle = 0.5 * (low + high)
        rates = _axis_rates(on.v, on.a, on.brake, math.cos(angle), along)
        time = drive_time(along[0], along[1], along[2], rates)
        other = _axis_rates(beside.v, beside.a, beside.brake, math.sin(angle), across)
        time_across = drive_time(across[0], across[1], across[2], other)
        longest = max(time, time_across)
        if time < time_across:
            low = angle
        else:
            high = angle
    return longest, 0.5 * (low + high)


@compiled
def turn_between(turn: float, w: float, rates: PlanarRates) -> tuple[float, float]:
    """Return the signed angle (rad) by which a base turns that starts at `w` (rad/s), and the time.

    It turns to the side on which it arrives first.
    """
    bounds = Rates(max(rates.w, abs(w)), 1.0, rates.aw, rates.aw, 1.0)
    angle = wrapped(turn)
    time = drive_time(angle, w, 0.0, bounds)
    if w != 0.0:
        other = angle - math.copysign(2.0 * math.pi, angle)
        other_time = drive_time(other, w, 0.0, bounds)
        if other_time < time:
            return other, other_time
    return angle, time


@compiled
def _limits_towards(
    direction: float, turned: float, share: float, rates: PlanarRates
) -> tuple[Rates, Rates]:
    """Return a share of the limits in a direction and across it, for all headings of a turn.

    The direction is relative to the heading before, in rad.
    """
    beside = direction + 0.5 * math.pi
    found = (0.0, 0.0, 0.0)
    other = (0.0, 0.0, 0.0)
    for number, angle in enumerate((direction, beside)):
        v = least_extent(rates.v, rates.v_back, rates.v_side, angle, turned, rates.box)
        a = least_extent(rates.a, rates.a, rates.a_side, angle, turned, rates.box)
        brake = least_extent(rates.brake, rates.brake, rates.a_side, angle, turned, rates.box)
        if number == 0:
            found = (share * v, share * a, share * brake)
        else:
            # Across, the base moves to either side.
            v = min(
                v,
                least_extent(
                    rates.v, rates.v_back, rates.v_side, angle - math.pi, turned, rates.box
                ),
            )
            other = (share * v, share * a, share * brake)
    return (
        Rates(found[0], 1.0, found[1], found[2], 1.0),
        Rates(other[0], 1.0, other[1], other[2], 1.0),
    )


@compiled
def _split(leg: PlanarLeg) -> tuple[float, Axis, Axis]:
    """Return the direction of a motion in rad, and its parts along and across the straight line."""
    direction = math.atan2(leg.y, leg.x)
    if leg.x == 0.0 and leg.y == 0.0:
        direction = math.atan2(leg.vy, leg.vx)
    cos = math.cos(direction)
    sin = math.sin(direction)
    along = (
        cos * leg.x + sin * leg.y,
        cos * leg.vx + sin * leg.vy,
        cos * leg.end_vx + sin * leg.end_vy,
    )
    across = (0.0, cos * leg.vy - sin * leg.vx, cos * leg.end_vy - sin * leg.end_vx)
    return direction, along, across


@compiled
def _facing_times(
    leg: PlanarLeg, facing: float, rates: PlanarRates
) -> tuple[float, float, float, float, float, float]:
    """Return the times of a drive between standstills with one heading between two turns.

    `facing` is that heading in rad. The base gains speed in the first turn, and loses it in the
    last one, within the least limits of their headings.

    Returns
    -------
    first, between, last : float
        Times in s of the first turn, of the drive between the turns, and of the last turn;
        `between` is infinite if the goal is too near.
    v_first, v_last : float
        Speeds in m/s after the first turn and before the last one.
    distance : float
        Of the drive between the turns, in m.
    """
    direction, along, _ = _split(leg)
    turn = wrapped(facing - leg.yaw)
    turn_back = wrapped(leg.yaw + leg.turn - facing)
    _, first = turn_between(turn, 0.0, rates)
    _, last = turn_between(turn_back, 0.0, rates)
    gaining, _ = _limits_towards(direction - leg.yaw, turn, 1.0, rates)
    on, _ = _limits_towards(direction - facing, 0.0, 1.0, rates)
    losing, _ = _limits_towards(direction - facing, turn_back, 1.0, rates)
    v_first = min(gaining.v, gaining.a * first)
    v_last = min(losing.v, losing.brake * last)
    distance = along[0] - v_first * (first - 0.5 * v_first / gaining.a)
    distance -= v_last * (last - 0.5 * v_last / losing.brake)
    between = np.inf
    if distance >= change_distance(v_first, v_last, on):
        between = drive_time(distance, v_first, v_last, on)
    return first, between, last, v_first, v_last, distance


@compiled
def fastest_leg(leg: PlanarLeg, rates: PlanarRates) -> tuple[float, float, float, float, float]:
    """Return the fastest motion of a leg.

    Returns
    -------
    duration : float
        In s.
    turned : float
        Signed angle of the turn in rad.
    split : float
        Angle in rad whose cosine and sine are the shares of the limits along and across the line.
    share : float
        Share of the limits that the translation uses: 1 unless the robot passes its goal, and the
        turn takes longer than the drive. No share may suffice for that, as near the goal: then the
        robot arrives before it is turned.
    facing : float
        The heading in rad between two turns, see `_facing_times`; NaN if the base turns at once. It
        then turns by `turned` in sum.
    """
    turned, turn_time = turn_between(leg.turn, leg.w, rates)
    direction, along, across = _split(leg)
    on, beside = _limits_towards(direction - leg.yaw, turned, 1.0, rates)
    time, split = _translation(along, across, on, beside)
    share = 1.0
    passes = leg.end_vx != 0.0 or leg.end_vy != 0.0
    if passes and time < turn_time:
        low = _LEAST_SHARE
        high = 1.0
        for _ in range(_SLOWINGS):
            tried = 0.5 * (low + high)
            on, beside = _limits_towards(direction - leg.yaw, turned, tried, rates)
            slower, slower_split = _translation(along, across, on, beside)
            if slower > _MOST_LATE * turn_time:  # it would have to drive back first
                low = tried
            else:
                if slower >= turn_time:
                    low = tried
                else:
                    high = tried
                time = slower
                split = slower_split
                share = tried
    time = max(time, turn_time)
    facing = math.nan
    if not _may_face(leg, rates):
        return time, turned, split, share, facing
    goal = leg.yaw + leg.turn
    for number in range(4):
        tried = direction + number * math.pi
        if number > 1:
            tried = leg.yaw if number == 2 else goal
        first, between, last, _, _, _ = _facing_times(leg, tried, rates)
        other = first + between + last
        if other < time - _BETTER:
            time = other
            facing = tried
            turned = abs(wrapped(tried - leg.yaw)) + abs(wrapped(goal - tried))
    return time, turned, split, share, facing


@compiled
def _may_face(leg: PlanarLeg, rates: PlanarRates) -> bool:
    """Return whether a leg between standstills may be faster with a heading of its own."""
    begins_slowly = math.hypot(leg.vx, leg.vy) <= _SLOW and abs(leg.w) <= _SLOW_TURN
    ends = leg.end_vx == 0.0 and leg.end_vy == 0.0
    speeds_alike = rates.v == rates.v_side and rates.v == rates.v_back
    changes_alike = rates.a == rates.a_side and rates.brake == rates.a_side
    is_alike = speeds_alike and changes_alike and not rates.box
    moves = leg.x != 0.0 or leg.y != 0.0
    return begins_slowly and ends and moves and not is_alike


@compiled
def leg_times(legs: FloatArray, hold: float, rates: PlanarRates) -> FloatArray:
    """Return times (s) and angles turned (rad) of the fastest motions, shape (2, n).

    `legs` are direct variables, see `ator_ros.bases.direct`; `hold` is the distance in m from the
    robot's point to a held object.
    """
    found = np.empty((2, legs.shape[1]))
    for at in range(legs.shape[1]):
        yaw = legs[YAW, at]
        heading = legs[YAWG, at]
        cos = math.cos(yaw)
        sin = math.sin(yaw)
        goal_cos = math.cos(heading)
        goal_sin = math.sin(heading)
        back = hold * legs[HOLD, at]
        leg = PlanarLeg(
            legs[XG, at] - back * goal_cos - legs[X, at],
            legs[YG, at] - back * goal_sin - legs[Y, at],
            cos * legs[V, at] - sin * legs[VY, at],
            sin * legs[V, at] + cos * legs[VY, at],
            legs[SPEEDG, at] * goal_cos,
            legs[SPEEDG, at] * goal_sin,
            yaw,
            legs[W, at],
            heading - yaw,
        )
        time, turned, _, _, _ = fastest_leg(leg, rates)
        found[0, at] = time
        found[1, at] = abs(turned)
    return found


Phase = tuple[float, float, float]
"""A phase of constant acceleration: duration in s, velocity before and after it."""


@dataclass(frozen=True, slots=True)
class _Profile:
    """A motion along one axis."""

    begin: float
    phases: tuple[Phase, ...]

    def at(self, time: float) -> tuple[float, float]:
        """Return position and velocity at a time in s from the start, constant outside."""
        position = self.begin
        speed = self.phases[0][1]
        left = max(time, 0.0)
        for duration, before, after in self.phases:
            passed = min(left, duration)
            speed = before + (after - before) * passed / duration if duration > 0.0 else after
            position += 0.5 * (before + speed) * passed
            left -= passed
            if left <= 0.0:
                return position, speed
        return position + left * speed, speed


def _phases(axis: Axis, rates: Rates) -> tuple[Phase, ...]:
    distance, before, after = axis
    gaining, steady, losing, peak = drive_parts(distance, before, after, rates)
    top = float(peak)
    return (
        (float(gaining), before, top),
        (float(steady), top, top),
        (float(losing), top, after),
    )


@dataclass(frozen=True, slots=True)
class PlanarPlan:
    """The fastest motion from a state to a pose, with a velocity there.

    Attributes
    ----------
    duration : float
        In s.
    goal : Pose
        Its end.
    """

    duration: float
    goal: Pose
    _start: Pose
    _direction: float
    _along: _Profile
    _across: _Profile
    _heading: _Profile

    def at(self, time: float) -> RobotState:
        """Return the planned state at a time in s from the start."""
        along, v_along = self._along.at(time)
        across, v_across = self._across.at(time)
        yaw, w = self._heading.at(time)
        cos = math.cos(self._direction)
        sin = math.sin(self._direction)
        pose = Pose(
            self._start.x + cos * along - sin * across,
            self._start.y + sin * along + cos * across,
            wrap_angle(yaw),
        )
        relative = self._direction - yaw
        vx = math.cos(relative) * v_along - math.sin(relative) * v_across
        vy = math.sin(relative) * v_along + math.cos(relative) * v_across
        return RobotState(pose, vx, w, vy=vy)

    def poses(self, interval: float) -> FloatArray:
        """Return the poses every `interval` s and at the end, shape (n, 3): x, y, yaw."""
        times = np.append(np.arange(0.0, self.duration, interval), self.duration)
        return np.array([self.at(float(time)).pose for time in times])


def planar_plan(start: RobotState, goal: Pose, speed: float, limits: OmniLimits) -> PlanarPlan:
    """Return the fastest motion from a state to a pose, with a forward speed in m/s there."""
    rates = limits.rates
    leg = _leg_between(start, goal, speed)
    duration, turned, split, share, facing = fastest_leg(leg, rates)
    if not math.isnan(facing):
        return _facing_plan(leg, facing, rates, start.pose, goal)
    direction, along, across = _split(leg)
    on, beside = _limits_towards(direction - leg.yaw, turned, share, rates)
    on = _axis_rates(on.v, on.a, on.brake, math.cos(split), along)
    beside = _axis_rates(beside.v, beside.a, beside.brake, math.sin(split), across)
    is_straight = split == 0.0
    return PlanarPlan(
        duration=duration,
        goal=goal,
        _start=start.pose,
        _direction=direction,
        _along=_Profile(0.0, _phases(along, on)),
        _across=_RESTING if is_straight else _Profile(0.0, _phases(across, beside)),
        _heading=_Profile(leg.yaw, _turn_phases(turned, leg.w, rates)),
    )


def _facing_plan(
    leg: PlanarLeg, facing: float, rates: PlanarRates, start: Pose, goal: Pose
) -> PlanarPlan:
    """Return the motion that keeps a heading in rad between two turns, see `_facing_times`."""
    first, between, last, v_first, v_last, distance = _facing_times(leg, facing, rates)
    direction, _, _ = _split(leg)
    turn = wrapped(facing - leg.yaw)
    turn_back = wrapped(leg.yaw + leg.turn - facing)
    gaining, _ = _limits_towards(direction - leg.yaw, turn, 1.0, rates)
    on, _ = _limits_towards(direction - facing, 0.0, 1.0, rates)
    losing, _ = _limits_towards(direction - facing, turn_back, 1.0, rates)
    gained = v_first / gaining.a
    lost = v_last / losing.brake
    along = (
        (gained, 0.0, v_first),
        (first - gained, v_first, v_first),
        *_phases((distance, v_first, v_last), on),
        (last - lost, v_last, v_last),
        (lost, v_last, 0.0),
    )
    heading = (
        *_turn_phases(turn, 0.0, rates),
        (between, 0.0, 0.0),
        *_turn_phases(turn_back, 0.0, rates),
    )
    return PlanarPlan(
        duration=first + between + last,
        goal=goal,
        _start=start,
        _direction=direction,
        _along=_Profile(0.0, along),
        _across=_RESTING,
        _heading=_Profile(leg.yaw, heading),
    )


def _turn_phases(angle: float, w: float, rates: PlanarRates) -> tuple[Phase, ...]:
    turning = Rates(max(rates.w, abs(w)), 1.0, rates.aw, rates.aw, 1.0)
    return _phases((angle, w, 0.0), turning)


_RESTING = _Profile(0.0, ((0.0, 0.0, 0.0),))


def _leg_between(start: RobotState, goal: Pose, speed: float) -> PlanarLeg:
    x, y, yaw = start.pose
    velocity = Pose(0.0, 0.0, yaw).compose(Pose(start.vx, start.vy, 0.0))
    return PlanarLeg(
        x=goal.x - x,
        y=goal.y - y,
        vx=velocity.x,
        vy=velocity.y,
        end_vx=speed * math.cos(goal.yaw),
        end_vy=speed * math.sin(goal.yaw),
        yaw=yaw,
        w=start.w,
        turn=goal.yaw - yaw,
    )
