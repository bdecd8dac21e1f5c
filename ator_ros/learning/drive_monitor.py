"""Watched drives of a server: estimates while they run, experience once they have ended."""

from __future__ import annotations

import math
from collections import defaultdict, deque
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ator_ros.bases.description import Robot
from ator_ros.bases.routes import LOOK_AHEAD
from ator_ros.domains.domain import Domain
from ator_ros.experience.server_drives import Watch
from ator_ros.experience.server_goals import ServerGoal, usual_values
from ator_ros.experience.table import Episode
from ator_ros.experience.watched_paths import WatchedPaths
from ator_ros.geometry import Pose
from ator_ros.learning.estimates import (
    BY_MODEL,
    BY_PATH_TIME,
    DriveEstimator,
    Estimate,
    ObservedDrives,
    Pace,
    direct_of_drives,
    drive_estimator,
    time_at_limits,
)
from ator_ros.performance.held_up import LEAST_DELAY, LEAST_RATIO
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.path_times import corrected
from ator_ros.world.state import RobotState

_FIRST = 20  # drives that correct path times; by then a model is learned
_MOST_IN_A_ROW = 3  # drives that are held up; after these the robot itself has become slower


@dataclass(frozen=True)
class EndedDrive:
    """A drive that has ended.

    Attributes
    ----------
    episode : Episode or None
        What it shows of its action; None: it is no experience.
    reason : str
        Why it is no experience; empty if it is.
    first : Estimate or None
        The first estimate; None: there was no path, or no pose of the robot in its frame.
    is_held_up : bool
        Whether it took much longer than a model predicted, unlike those just before it.
    """

    goal: ServerGoal
    episode: Episode | None
    reason: str
    first: Estimate | None = None
    is_held_up: bool = False

    @property
    def duration(self) -> float:
        """In s; NaN if it is unknown."""
        return self.goal.end - self.goal.begin


class DriveMonitor:
    """Watches the drives of one robot, see `Watch`, and estimates those that run.

    Parameters
    ----------
    domain : Domain
        Its remote actions are watched. Paths of the servers are its routes on the map.
    frame : str
        The frame of map and goals. Goals in other frames are estimated only.
    paths : WatchedPaths
        The routes of predictions. It receives the paths of running drives, and keeps those of
        drives that are experience: `ended` may raise OSError.

    Attributes
    ----------
    watch : Watch
        Takes all messages.
    domain : Domain
        The given one, with the watched paths as routes: models for `use` are for it.
    observed : ObservedDrives
        What drives have shown so far.
    """

    def __init__(
        self,
        robot: Robot,
        domain: Domain,
        frame: str,
        paths: WatchedPaths,
        *,
        robot_in_tf: bool = False,
        others: Collection[str] = (),
    ) -> None:
        self.watch = Watch(robot, domain, robot_in_tf=robot_in_tf, others=others)
        self._robot = robot
        self._frame = frame
        self._paths = paths
        self.domain = driven_on(self._paths, domain)
        self.observed = ObservedDrives()
        self._models: dict[str, PerformanceModel] = {}
        self._first_drives: defaultdict[str, deque[tuple[RobotState, Pose, float]]] = defaultdict(
            lambda: deque(maxlen=_FIRST)
        )
        """By action: start, goal and duration in s of the newest drives without a learned model."""
        self._source = ""
        self._in_a_row = 0  # drives that were held up
        self._estimators: dict[bytes, DriveEstimator] = {}
        self._first: dict[bytes, Estimate] = {}

    def on_map(self, domain: Domain) -> None:
        """Watch drives on another map, that of the given domain."""
        self.domain = driven_on(self._paths, domain)

    def use(self, models: Mapping[str, PerformanceModel], source: str) -> None:
        """Estimate drives that start from now on with models, by action.

        `source` says what the learned ones are learned from. The others predict path times, which
        the drives correct that are watched until there is a learned one.
        """
        self._models = dict(models)
        self._source = source
        for action in self._first_drives:
            self._correct(action)

    def _correct(self, action: str) -> None:
        """Correct path times by the first drives of an action, if its model is not learned."""
        model = self._models.get(action)
        drives = self._first_drives[action]
        if model is None or model.is_learned or not drives:
            return
        values = usual_values(self.domain, action)
        direct = direct_of_drives([drive[:2] for drive in drives], values)
        self._models[action] = corrected(model, direct, [duration for *_, duration in drives])

    def _basis(self, action: str) -> str:
        model = self._models.get(action)
        if model is not None and model.is_learned:
            return f"{BY_MODEL} {self._source}"
        return f"{BY_PATH_TIME}, corrected by {len(self._first_drives[action])} drives"

    def estimates(self) -> list[tuple[ServerGoal, Estimate]]:
        """Return the present estimate of each running drive with a path, the oldest first."""
        found = []
        for goal in self.watch.active:
            robot = self.watch.robot_in(goal.frame)
            if robot is None or goal.path is None:
                continue
            if goal.goal_id not in self._estimators:
                self._start(goal)
            estimator = self._estimators.get(goal.goal_id)
            if estimator is not None:
                elapsed = max(0.0, self.watch.now - goal.begin)
                estimate = estimator.estimate(elapsed, robot.pose, goal.path)
                found.append((goal, estimate))
        return found

    def _start(self, goal: ServerGoal) -> None:
        """Predict a drive for the first time, from where it began."""
        start = goal.start_in_frame
        if start is None or goal.pose is None or goal.first_path is None:
            return
        model = self._models.get(goal.action) if goal.frame == self._frame else None
        if model is not None:  # else its path may lead through other poses
            self._paths.add(start.pose[:2], goal.pose[:2], goal.first_path)
        estimator = drive_estimator(
            self._robot,
            start,
            goal.pose,
            goal.first_path,
            model=model,
            observed=self.observed,
            values=usual_values(self.domain, goal.action),
            source=self._basis(goal.action),
        )
        self._estimators[goal.goal_id] = estimator
        self._first[goal.goal_id] = estimator.at_start()

    def ended(self) -> list[EndedDrive]:
        """Return the drives that have ended since the last call, and forget what they needed.

        A drive through several poses is one to each of them.
        """
        found = []
        for goal in self.watch.take_ended():
            self._estimators.pop(goal.goal_id, None)
            first = self._first.pop(goal.goal_id, None)
            legs = self.watch.legs(goal)
            if isinstance(legs, str):
                found.append(EndedDrive(goal, None, legs, first))
            else:  # the estimate was for all legs
                found += [self._ended(leg, first if leg is goal else None) for leg in legs]
        self.watch.forget()
        return found

    def _ended(self, goal: ServerGoal, first: Estimate | None) -> EndedDrive:
        made = self.watch.episode(goal)
        if isinstance(made, str):
            return EndedDrive(goal, None, made, first)
        if goal.frame != self._frame:
            reason = f"its goal is in {goal.frame}, expected {self._frame}"
            return EndedDrive(goal, None, reason, first)
        path = goal.first_path
        situation = made.situation
        model = self._models.get(goal.action)
        is_learned = model is not None and model.is_learned
        if path is not None and made.success:
            self._paths.save(situation.robot.pose[:2], situation.goal.pose[:2], path)
            length = float(np.hypot(*np.diff(path, axis=0).T).sum())
            if not goal.is_passed and length > LOOK_AHEAD:  # turns on the spot show no speed
                limit = time_at_limits(self._robot, situation.robot, situation.goal.pose, path)
                self.observed.add(limit, made.duration, _pace_of(made))
            if not is_learned and not goal.is_passed:
                drive = situation.robot, situation.goal.pose, made.duration
                self._first_drives[goal.action].append(drive)
                self._correct(goal.action)
        is_late = (
            first is not None
            and is_learned
            and made.duration > max(LEAST_RATIO * first.total, LEAST_DELAY + first.total)
        )
        self._in_a_row = self._in_a_row + 1 if is_late else 0
        is_held_up = is_late and self._in_a_row <= _MOST_IN_A_ROW
        return EndedDrive(goal, made, "", first, is_held_up)


def _pace_of(drive: Episode) -> Pace:
    """Return how a drive was driven at most; the speed is NaN where it is unknown."""
    speed = math.nan
    if drive.samples is not None:
        speed = float(np.percentile(np.abs(drive.samples[:, 4]), 98.0))
    return Pace(speed, drive.position_error, drive.heading_error)


def driven_on(paths: WatchedPaths, domain: Domain) -> Domain:
    """Return a domain whose routes on the map are watched paths."""
    return replace(domain, planner=lambda *_: paths)
