"""Estimation of a base's latency, lag, limits and dead zone from a probe drive."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.optimize import least_squares

from ator_ros.bases.differential.limits import Limits
from ator_ros.bases.differential.probe_drive import DriveError, DrivePart, DriveSample
from ator_ros.bases.differential.response import AxisResponse
from ator_ros.geometry import FloatArray

_LATENCIES = (0.0, 0.05, 0.1, 0.15, 0.2, 0.3)
_LAGS = (0.03, 0.12)
_LOWER = (0.0, 0.002, 0.01, 0.01, 0.01, 0.05)
_LONGEST = 0.6  # s; greatest latency and lag
_FASTEST = 10.0  # m/s and rad/s
_QUICKEST = 30.0  # m/s^2 and rad/s^2; greatest change of speed
_UPPER = (_LONGEST, _LONGEST, _FASTEST, _QUICKEST, _QUICKEST, 200.0)
_STARTS = 3
_RESPONDING = 0.5  # least share of a creeping command with which a base moves outside its dead zone
_LAST = 0.25  # s at the end of a creeping step that are evaluated
_REACHED = 0.97  # share of the greatest command below which a steady speed is a limit of the base
_NEAR = 0.02  # share of the limit by which a speed would have exceeded it without it, besides noise
_HELD = 0.15  # s; least time at the limit: in each sprint the speed has to be steady for 0.3 s
_FEWEST = 3  # least number of samples in that time
_FAR_BELOW = 0.5  # share of the greatest command below which an unreached limit says nothing
_UNFIT = 0.15  # RMS error, as a share of the greatest speed, of a base that follows otherwise
_IDEAL = 0.3  # share of the greatest change of speed above which a base is taken for an ideal one
_ALIKE = 0.15  # greatest difference of the speeds in both directions, as a share of the greater one
_EDGE = (
    0.99  # share of the greatest value that the fit allows, from which an estimate is only a bound
)
_LEAST_TURN = 0.5  # rad; turns on the spot by less do not show which point odometry describes


@dataclass(frozen=True, slots=True)
class AxisEstimate:
    """The estimate of one axis of a base, in m/s or rad/s."""

    response: AxisResponse
    dead_zone: float  # greatest creeping command without motion
    limited: bool  # whether the greatest measured speed is the limit of the base
    error: float  # RMS difference of measured and fitted speeds
    commanded: float  # greatest command
    reached: tuple[float, float]  # greatest mean speeds ahead or to the left, and the other way


@dataclass(frozen=True, slots=True)
class BaseEstimate:
    """The estimates of both axes."""

    driving: AxisEstimate
    turning: AxisEstimate
    # m; the point whose pose odometry gives, ahead of the middle of the axle and to its left
    point: tuple[float, float] = (0.0, 0.0)

    @property
    def latency(self) -> float:
        """Time in s from the stamp of a state until the command for it moves the base."""
        return 0.5 * (self.driving.response.latency + self.turning.response.latency)

    @property
    def lag(self) -> float:
        """Time constant of the motors in s."""
        return 0.5 * (self.driving.response.lag + self.turning.response.lag)

    @property
    def limits(self) -> Limits:
        """Greatest speeds and accelerations.

        For turning the lower one of gaining and losing speed.
        """
        v = self.driving.response
        w = self.turning.response
        return Limits(v=v.limit, w=w.limit, a=v.gain, brake=v.loss, aw=min(w.gain, w.loss))


def identify(samples: Sequence[DriveSample]) -> BaseEstimate:
    """Estimate the response of a base from the samples of a probe drive.

    DriveError if a part is missing.
    """
    return BaseEstimate(
        _axis(samples, DrivePart.SPRINT_V, DrivePart.CREEP_V, lambda s: (s.command.vx, s.robot.vx)),
        _axis(samples, DrivePart.SPRINT_W, DrivePart.CREEP_W, lambda s: (s.command.w, s.robot.w)),
        _point([sample for sample in samples if sample.part is DrivePart.SPRINT_W]),
    )


def check_plausible(estimate: BaseEstimate) -> None:
    """Raise DriveError if an estimate cannot be right; the message names it and the remedy."""
    for name, axis, unit in (("v", estimate.driving, "m/s"), ("w", estimate.turning, "rad/s")):
        response = axis.response
        least = _FAR_BELOW * axis.commanded
        slower, faster = sorted(axis.reached)
        if 0.0 < slower < (1.0 - _ALIKE) * faster:
            raise DriveError(
                f"response of {name}: expected like speeds in both directions, "
                f"got {axis.reached[0]:.2f} and {axis.reached[1]:.2f} {unit}; "
                f"give a --{name} that the base reaches in both, or "
                "correct its driver"
            )
        if axis.error > _UNFIT * response.limit:
            raise DriveError(
                f"response of {name}: expected odometry that follows the commands within "
                f"{_UNFIT * response.limit:.3f} {unit} (RMS), got {axis.error:.3f}; check that the "
                "wheels grip, that nothing is in the way, and sign and unit of odometry's twist"
            )
        if not axis.limited and response.limit < least:
            raise DriveError(
                f"limits.{name}: expected at least half of the commanded "
                f"{axis.commanded:.2f} {unit}, "
                f"got {response.limit:.2f} {unit} while the base still accelerated; "
                f"give more --space, or a lower --{name}"
            )
        for what, value in (("latency", response.latency), ("lag", response.lag)):
            if value > _EDGE * _LONGEST:
                raise DriveError(
                    f"{what} of {name}: expected less than {_LONGEST:g} s, got more; "
                    "check the stamps of odometry"
                )
        # An ideal base gains and loses speed at once.
        slowest, quickest = sorted((response.gain, response.loss))
        if quickest > _EDGE * _QUICKEST and slowest < _IDEAL * _QUICKEST:
            what = "loss" if response.loss > response.gain else "gain"
            raise DriveError(
                f"{what} of speed of {name}: expected less than {_QUICKEST:g} {unit}^2, got more; "
                "check the stamps of odometry, and that nothing is in the way"
            )


def _point(spins: Sequence[DriveSample]) -> tuple[float, float]:
    """Return where odometry's point lies, in m ahead and to the left of the axle.

    In turns on the spot, with no drive between them, it moves in a circle around the middle of the
    axle; the circle is fitted by least squares. (0, 0) if the robot hardly turned.
    """
    yaws = np.unwrap([sample.robot.pose.yaw for sample in spins])
    if len(yaws) < _FEWEST or float(np.ptp(yaws)) < _LEAST_TURN:
        return 0.0, 0.0
    cos = np.cos(yaws)
    sin = np.sin(yaws)
    one = np.ones_like(yaws)
    zero = np.zeros_like(yaws)
    # x = center_x + ahead cos(yaw) - left sin(yaw), y = center_y + ahead sin(yaw) + left cos(yaw)
    rows = np.concatenate(
        (
            np.stack((one, zero, cos, -sin), axis=1),
            np.stack((zero, one, sin, cos), axis=1),
        )
    )
    places = [sample.robot.pose.x for sample in spins] + [sample.robot.pose.y for sample in spins]
    ahead, left = np.linalg.lstsq(rows, np.array(places), rcond=None)[0][2:].tolist()
    return ahead, left


def _axis(
    samples: Sequence[DriveSample],
    sprint: DrivePart,
    creep: DrivePart,
    of: Callable[[DriveSample], tuple[float, float]],
) -> AxisEstimate:
    fast = [sample for sample in samples if sample.part is sprint]
    slow = [sample for sample in samples if sample.part is creep]
    if not fast or not slow:
        raise DriveError(
            f"samples: expected those of the parts {sprint.value} and {creep.value}, got none"
        )
    times = [sample.time for sample in fast]
    commands, speeds = np.array([of(sample) for sample in fast]).T
    top = float(np.abs(speeds).max())
    if top == 0.0:
        raise DriveError(
            f"odometry: expected the speed of a base that moves in the part {sprint.value}, "
            "got 0 in all messages; correct a bias of the twist, which looks like motion"
        )
    response = _fitted(times, commands, speeds)
    fitted = response.speeds(times, commands.tolist())
    rms = float(np.sqrt(np.mean((fitted - speeds) ** 2)))
    commanded = float(np.abs(commands).max())
    limited = response.limit < _REACHED * commanded and _is_held(response, times, commands, rms)
    if not limited:  # the fit may exceed the speed that was reached, and noise the fit
        most = min(response.limit, float(np.abs(fitted).max()), top)
        response = replace(response, limit=most)
    reached = (
        _reached(times, speeds * (commands > 0.0)),
        _reached(times, -speeds * (commands < 0.0)),
    )
    dead_zone = _dead_zone([(s.time, *of(s)) for s in slow])
    return AxisEstimate(response, dead_zone, bool(limited), rms, commanded, reached)


def _reached(times: Sequence[float], speeds: FloatArray) -> float:
    """Return the greatest mean speed during `_HELD`, so that noise matters less."""
    count = max(1, round(_HELD / float(np.median(np.diff(times))))) if len(times) > 1 else 1
    count = min(count, len(speeds))
    return float(np.convolve(speeds, np.full(count, 1.0 / count), "valid").max())


def _is_held(
    response: AxisResponse,
    times: Sequence[float],
    commands: FloatArray,
    noise: float,
) -> bool:
    """Return whether the limit held the base back: the fit would go on to gain speed without it."""
    unlimited = replace(response, limit=_FASTEST).speeds(times, commands.tolist())
    least = response.limit + max(_NEAR * response.limit, noise)
    beyond = (np.abs(unlimited) > least) & (np.abs(commands) > response.limit)
    return int(beyond.sum()) >= _FEWEST and float(np.diff(times)[beyond[:-1]].sum()) >= _HELD


def _fitted(times: Sequence[float], commands: FloatArray, speeds: FloatArray) -> AxisResponse:
    """Fit a response by least squares from several starts, as latency and lag are similar."""
    sent = commands.tolist()

    def errors(values: FloatArray) -> FloatArray:
        return AxisResponse(*values.tolist()).speeds(times, sent) - speeds

    top = float(np.abs(speeds).max())
    # The 90th percentile of the change of speed over 0.2 s, in m/s^2 or rad/s^2.
    pairs = enumerate(np.searchsorted(times, np.add(times, 0.2 - 1e-6)))
    slopes = [
        abs(speeds[j] - speeds[i]) / (times[j] - times[i]) for i, j in pairs if j < len(times)
    ]
    rate = max(0.05, float(np.percentile(slopes, 90)) if slopes else 0.0)
    starts = [
        np.clip(
            [latency, lag, top, rate, rate, 4.0 * rate],
            np.add(_LOWER, 1e-6),
            np.subtract(_UPPER, 1e-6),
        )
        for latency, lag in product(_LATENCIES, _LAGS)
    ]
    starts.sort(key=lambda start: float(np.sum(errors(start) ** 2)))
    fits = [
        least_squares(
            errors,
            start,
            bounds=(_LOWER, _UPPER),
            x_scale=(0.05, 0.05, top, rate, rate, rate),
        )
        for start in starts[:_STARTS]
    ]
    return AxisResponse(*min(fits, key=lambda fit: float(fit.cost)).x.tolist())


def _dead_zone(creep: Sequence[tuple[float, float, float]]) -> float:
    """Return the greatest creeping command to which the base does not respond.

    0 if it responds to all.
    """
    by_command: dict[float, list[tuple[float, float]]] = {}
    for time, command, speed in creep:
        by_command.setdefault(command, []).append((time, speed))
    still = [0.0]
    for command, rows in by_command.items():
        last = [abs(speed) for time, speed in rows if time > rows[-1][0] - _LAST]
        if command and float(np.mean(last)) < _RESPONDING * command:
            still.append(command)
    return max(still)
