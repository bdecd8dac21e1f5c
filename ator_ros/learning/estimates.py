"""How long a running goal of an action server takes: predicted at its start, corrected on its way.

The prediction is a model's; before one is learned, that of path times, which the first drives
correct. Of a server without a model, such as one that drives through poses, it is the time of its
whole path with all turns, as late as former drives.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from ator_ros.actions.goal_variables import direct_name
from ator_ros.bases.description import Robot
from ator_ros.bases.direct import DIRECT_VARIABLES
from ator_ros.bases.planned_routes import route_along
from ator_ros.bases.routes import LOOK_AHEAD
from ator_ros.geometry import FloatArray, Pose, wrap_angle
from ator_ros.performance.model import PerformanceModel
from ator_ros.world.state import RobotState

BY_MODEL = "model"
BY_PATH_TIME = "path time"
BY_DRIVES = "time of the path at the limits, as late as former drives"
BY_LIMITS = "time of the path at the limits"
"""What an estimate is based on; the text of a model continues with what it is learned from."""
_FEWEST = 3  # drives that show the robot's speed
_REMEMBERED = 50  # newest drives that count for it
_AHEAD = 3.0  # m of its path that a robot drives between two estimates; it may cross itself later
_USUAL_SPREAD = 0.2  # share of a duration by which that of former drives errs: some s of 15 s
_USUAL_SHORT = 0.25  # m and rad from its goal, where Nav2 ends drives by default
_BOUND = 1.2816  # standard deviations that nine of ten keep


@dataclass(frozen=True)
class Estimate:
    """How long a drive takes, in s.

    Attributes
    ----------
    elapsed, remaining : float
        Since the goal was accepted, and from now on.
    spread : float
        Standard deviation of `remaining`.
    bound : float
        From now on, what nine of ten such drives keep.
    basis : str
        What it comes from: a model, or length and speed.
    """

    elapsed: float
    remaining: float
    spread: float
    bound: float
    basis: str

    @property
    def total(self) -> float:
        """Duration of the whole drive in s."""
        return self.elapsed + self.remaining


@dataclass(frozen=True)
class Pace:
    """How a server drives at most, which bounds the time that the rest of a path takes.

    Attributes
    ----------
    speed : float
        Greatest one in m/s.
    ends_within, ends_within_angle : float
        How far from its goal it ends drives at most, in m and rad.
    """

    speed: float
    ends_within: float
    ends_within_angle: float


class ObservedDrives:
    """How long the newest drives that arrived took, by `time_at_limits`, and their pace."""

    def __init__(self) -> None:
        self._times: deque[tuple[float, float]] = deque(maxlen=_REMEMBERED)
        self._paces: deque[Pace] = deque(maxlen=_REMEMBERED)

    def add(self, at_limits: float, duration: float, pace: Pace) -> None:
        """Add a drive in `duration` s on a path that takes `at_limits` s, see `time_at_limits`."""
        if at_limits > 0.0 and duration > 0.0:
            self._times.append((at_limits, duration))
        if all(map(math.isfinite, (pace.speed, pace.ends_within, pace.ends_within_angle))):
            self._paces.append(pace)

    @property
    def lateness(self) -> float:
        """Duration of all drives by that at the limits; NaN before three of them."""
        if len(self._times) < _FEWEST:
            return math.nan
        at_limits, duration = np.sum(self._times, axis=0)
        return float(duration / at_limits)

    @property
    def pace(self) -> Pace | None:
        """The median of the greatest speeds, and the greatest of the others; None before three."""
        if len(self._paces) < _FEWEST:
            return None
        return Pace(
            float(np.median([pace.speed for pace in self._paces])),
            max(pace.ends_within for pace in self._paces),
            max(pace.ends_within_angle for pace in self._paces),
        )


@dataclass
class DriveEstimator:
    """Estimates a running drive.

    At its start `total` s are predicted. The estimate keeps that total as long as the rest of the
    path neither needs more time nor leaves less to do. What is left takes at least the length at
    the greatest speed, and the turn at its end. It takes at most the length at the greatest speed,
    and the predicted extra time with its spread. An estimate outside these bounds is moved to the
    nearer one.

    Attributes
    ----------
    total, spread, bound : float
        Predicted at the start, in s; `bound` is what nine of ten such drives take at most.
    basis : str
        What the prediction comes from.
    pace : Pace
        How the server drives at most.
    turn_rate : float
        The robot's greatest one in rad/s; that of drives without great turns is no bound.
    extra_time : float
        Predicted time in s beyond that of the length at the greatest speed.
    goal_yaw : float
        The goal's heading in rad, to which the robot turns at the end of the path.
    """

    total: float
    spread: float
    bound: float
    basis: str
    pace: Pace
    turn_rate: float
    extra_time: float
    goal_yaw: float
    _near: int = field(default=0, init=False)
    _last_turn: float = field(default=0.0, init=False)
    _path: FloatArray | None = field(default=None, init=False)

    def at_start(self) -> Estimate:
        """Return the estimate before the robot has moved."""
        return self._estimate(0.0, self.total)

    def estimate(self, elapsed: float, place: Pose, path: FloatArray) -> Estimate:
        """Return the estimate after `elapsed` s at a place, on the newest path, shape (n, 2), m."""
        pace = self.pace
        rest = self._rest_of(path, place)
        turn = self._last_turn
        if rest < LOOK_AHEAD:
            turn = min(turn, abs(wrap_angle(self.goal_yaw - place.yaw)))
        driving = max(0.0, rest - pace.ends_within) / pace.speed
        turning = max(0.0, turn - pace.ends_within_angle) / self.turn_rate
        least = driving + turning
        most = rest / pace.speed + self.extra_time + self.spread
        remaining = max(least, min(self.total - elapsed, most))
        return self._estimate(elapsed, remaining)

    def _estimate(self, elapsed: float, remaining: float) -> Estimate:
        late = max(0.0, self.bound - self.total)
        return Estimate(elapsed, remaining, self.spread, remaining + late, self.basis)

    def _rest_of(self, path: FloatArray, place: Pose) -> float:
        """Return the length in m that is left of a path, from the place next to the robot."""
        if path is not self._path:
            self._path = path
            self._near = 0
            _, _, _, arrival, _ = route_along(path, LOOK_AHEAD)
            self._last_turn = abs(wrap_angle(self.goal_yaw - arrival))
        left = path[self._near :]
        steps = np.hypot(*np.diff(left, axis=0).T)
        offsets = np.hypot(*(left - (place.x, place.y)).T)
        is_ahead = np.append(0.0, np.cumsum(steps)) <= _AHEAD
        near = int(np.argmin(np.where(is_ahead, offsets, math.inf)))
        self._near += near
        following = min(near + 1, len(left) - 1)
        return float(offsets[following] + steps[following:].sum())


def drive_estimator(
    robot: Robot,
    start: RobotState,
    goal: Pose,
    path: FloatArray,
    *,
    model: PerformanceModel | None,
    observed: ObservedDrives,
    values: Mapping[str, float] = MappingProxyType({}),
    source: str = "",
) -> DriveEstimator:
    """Return the estimator of a drive that starts on a path, shape (n, 2), in m.

    Parameters
    ----------
    robot : Robot
        Its limits count until drives show others.
    start : RobotState
        At the start, in the frame of the path.
    goal : Pose
        Of the robot at the end.
    model : PerformanceModel or None
        Predicts the duration, unless the path is none of the map for it.
    values : mapping
        Of the goal variables that the action declares.
    source : str
        What the model is, for `basis`.
    """
    pace = observed.pace
    if pace is None:
        pace = Pace(robot.greatest_speed(), _USUAL_SHORT, _USUAL_SHORT)
    shortest = float(np.hypot(*np.diff(path, axis=0).T).sum()) / pace.speed
    predicted = None if model is None else _predicted(model, start, goal, values)
    if predicted is not None:
        total, spread, bound = predicted
        basis = source
    else:
        is_known = not math.isnan(observed.lateness)
        lateness = observed.lateness if is_known else 1.0
        total = lateness * time_at_limits(robot, start, goal, path)
        spread = _USUAL_SPREAD * total
        bound = total + _BOUND * spread
        basis = BY_DRIVES if is_known else BY_LIMITS
    return DriveEstimator(
        total,
        spread,
        bound,
        basis,
        pace,
        robot.greatest_turn_rate,
        extra_time=max(0.0, total - shortest),
        goal_yaw=goal.yaw,
    )


def time_at_limits(robot: Robot, start: RobotState, goal: Pose, path: FloatArray) -> float:
    """Return the time in s of a path, shape (n, 2), in m, with all its turns at the limits."""
    length, turn, departure, arrival, _ = route_along(path, LOOK_AHEAD)
    first = wrap_angle(departure - start.pose.yaw)
    last = wrap_angle(goal.yaw - arrival)
    turns = [np.array([abs(angle)]) for angle in (first, turn, last)]
    at_rest = np.zeros(1)
    found = robot.route_time(np.array([length]), turns, np.array([start.vx]), at_rest)
    return float(found[0])


def direct_of_drives(
    drives: Sequence[tuple[RobotState, Pose]], values: Mapping[str, float]
) -> dict[str, FloatArray]:
    """Return the direct variables of n drives to a goal at rest, arrays of shape (n,).

    `values` are those of the goal variables that the action declares.
    """
    rows = [(*start.pose, start.vx, start.w, start.vy, *goal, 0.0, 0.0) for start, goal in drives]
    columns = np.array(rows, dtype=float).T
    declared = {direct_name(name): np.full(len(rows), value) for name, value in values.items()}
    return dict(zip(DIRECT_VARIABLES, columns, strict=True)) | declared


def _predicted(
    model: PerformanceModel, start: RobotState, goal: Pose, values: Mapping[str, float]
) -> tuple[float, float, float] | None:
    """Return duration, spread and bound in s; None where the model predicts none."""
    direct = direct_of_drives([(start, goal)], values)
    found = model.predict(direct, ("duration", "spread"))
    columns = (found.duration, found.spread, found.bound)
    numbers = [float(column[0]) for column in columns if column is not None]
    if len(numbers) < 3 or not all(map(math.isfinite, numbers)):
        return None
    return numbers[0], numbers[1], numbers[2]
