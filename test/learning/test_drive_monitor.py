"""Drives that are watched: estimated from their first path on, and experience at their end."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from bags import ROBOT
from domain_files import changed, file_of
from watched_robot import ABORTED, EXECUTING, SPEED, SUCCEEDED, Robot

from ator_ros.actions import DEFAULT_SET
from ator_ros.actions.goal_variables import STOP
from ator_ros.domains.available_models import with_path_times
from ator_ros.domains.domain import find_domain
from ator_ros.experience.watched_paths import PATHS, WatchedPaths
from ator_ros.learning.drive_monitor import DriveMonitor, EndedDrive
from ator_ros.learning.estimates import BY_PATH_TIME

DURATION = 1.0 / SPEED


class Learned:
    """A learned model that predicts the usual duration of all drives."""

    is_learned = True

    def predict(self, direct: Any, measures: Any) -> Any:
        one = np.ones(1)
        return SimpleNamespace(duration=DURATION * one, spread=0.1 * one, bound=2.2 * one)


class Watched:
    """A monitor and the robot that it watches."""

    def __init__(self, folder: Path, frame: str = "odom", *, early: bool = False) -> None:
        content = changed("tops.0.pre", [])
        content["actions"][0]["remote"]["early"] = early
        domain = find_domain(str(file_of(folder, content)))
        self.file = folder / PATHS
        self.monitor = DriveMonitor(ROBOT, domain, frame, WatchedPaths(self.file))
        self.robot = Robot(self.monitor.watch)
        self.domain = domain

    def drive(self, number: int, waits: float = 0.0) -> EndedDrive:
        self.robot.odometry(0.0)
        self.robot.start(number)
        assert len(self.monitor.estimates()) == 1
        self.robot.finish(number, SUCCEEDED, waits)
        (ended,) = self.monitor.ended()
        return ended


@pytest.fixture
def watched(tmp_path: Path) -> Watched:
    return Watched(tmp_path)


def test_path_times_are_corrected_by_each_drive(watched: Watched) -> None:
    models = with_path_times({}, watched.domain, ROBOT, DEFAULT_SET)
    watched.monitor.use(models, "")
    drives = [watched.drive(number) for number in range(4)]
    errors = [abs(drive.first.total - DURATION) for drive in drives if drive.first]
    assert errors[3] < 0.5 * errors[0]
    assert [drive.first.basis for drive in drives if drive.first][3] == (
        "path time, corrected by 3 drives"
    )


def test_estimates_follow_the_drive(watched: Watched) -> None:
    watched.monitor.use({"navigate": Learned()}, "1f0c")  # type: ignore[dict-item]
    watched.robot.start(1)
    ((_, first),) = watched.monitor.estimates()
    assert (first.total, first.basis) == (pytest.approx(DURATION), "model 1f0c")
    for _ in range(20):
        watched.robot.odometry(SPEED)
    ((goal, later),) = watched.monitor.estimates()
    assert later.elapsed == pytest.approx(1.0)
    assert later.remaining == pytest.approx(DURATION - 1.0, abs=0.1)
    assert goal.pose is not None
    assert goal.pose.x == pytest.approx(1.0)


def test_a_drive_that_takes_much_longer_is_held_up_unless_all_do(watched: Watched) -> None:
    watched.monitor.use({"navigate": Learned()}, "")  # type: ignore[dict-item]
    assert not watched.drive(1).is_held_up
    assert watched.drive(2, waits=4.0).is_held_up
    slow = [watched.drive(3 + number, waits=4.0).is_held_up for number in range(4)]
    assert slow == [True, True, False, False]


def test_drives_of_a_server_that_can_pass_goals_stop_at_them(tmp_path: Path) -> None:
    watched = Watched(tmp_path, early=True)
    watched.monitor.use(with_path_times({}, watched.domain, ROBOT, DEFAULT_SET), "")
    for number in range(2):  # the second one is predicted by the first
        drive = watched.drive(number)
        assert drive.first is not None
        assert drive.first.basis.startswith(BY_PATH_TIME)
        assert drive.episode is not None
        assert drive.episode.situation.goal.values == {STOP: 1.0}


def test_drives_that_pass_their_goals_bound_no_other_drive(tmp_path: Path) -> None:
    watched = Watched(tmp_path, early=True)
    robot = watched.robot
    watched.monitor.use({"navigate": Learned()}, "")  # type: ignore[dict-item]
    robot.odometry(0.0)
    robot.start(0)

    def drive_on(ticks: int) -> None:
        for _ in range(ticks):
            robot.odometry(SPEED * 2.0)  # 0.05 m

    drive_on(5)
    for number in range(4):
        drive_on(13)  # 0.9 m of 1 m
        robot.set_state(number + 1, EXECUTING)
        robot.set_state(number, ABORTED)
        robot.plan((robot.x, 0.0), (robot.x + 1.0, 0.0))
        ((_, estimate),) = watched.monitor.estimates()
        assert estimate.remaining == pytest.approx(DURATION)
        assert watched.monitor.ended() == []
        drive_on(5)  # beyond the goal
        (drive,) = watched.monitor.ended()
        assert drive.goal.is_passed
        assert drive.episode is not None
    assert watched.monitor.observed.pace is None


def test_paths_of_drives_survive_a_restart(watched: Watched) -> None:
    drive = watched.drive(1)
    assert drive.episode is not None
    start = drive.episode.situation.robot.pose
    goal = drive.episode.situation.goal.pose
    assert WatchedPaths(watched.file)(start[:2], goal[:2]) is not None


def test_goals_in_other_frames_are_estimated_only(tmp_path: Path) -> None:
    drive = Watched(tmp_path, frame="map").drive(1)
    assert drive.first is not None
    assert drive.episode is None
    assert drive.reason == "its goal is in odom, expected map"
