"""What drives never varied is named, and can be driven."""

import math

import numpy as np
import pandas as pd
from experience_rows import dead_zone_drives

from ator_ros.actions.base import Goal
from ator_ros.actions.situation import Situation
from ator_ros.bases.description import load_robot
from ator_ros.geometry import Pose
from ator_ros.performance.coverage import Coverage, Unlike, unvaried
from ator_ros.performance.training import train
from ator_ros.world.state import RobotState

ROBOT = load_robot()
DRIVES = dead_zone_drives(40, seed=1)


def arriving_straight(rows: pd.DataFrame, turned: float = 0.0) -> pd.DataFrame:
    """Return drives that end turned by an angle (rad)."""
    bearing = np.arctan2(rows["yg"] - rows["y"], rows["xg"] - rows["x"])
    return rows.assign(yawg=bearing + turned)


def to(x: float, yaw: float) -> Situation:
    """Return a drive along x from the origin that ends turned by `yaw` (rad)."""
    return Situation("drive_to", RobotState(Pose(0.0, 0.0, 0.0)), {}, Goal(Pose(x, 0.0, yaw)))


def remarks(rows: pd.DataFrame) -> list[str]:
    return unvaried(train("drive_to", rows, ROBOT))


def test_random_drives_vary_everything() -> None:
    assert remarks(DRIVES) == []


def test_headings_that_were_never_driven_are_named() -> None:
    (remark,) = remarks(arriving_straight(DRIVES, math.radians(2.5)))
    assert remark.startswith("drive_to: no drive ended turned by more than 3°: headings cannot be")
    assert remark.endswith("20 drives to random headings are enough")


def test_drives_between_two_docks_vary_nothing() -> None:
    rows = DRIVES.assign(x=0.0, y=0.0, yaw=0.0, xg=1.0, yg=0.0, yawg=0.0)
    length, began, ended = remarks(rows)
    assert "no drive was longer than 1 m, or much shorter" in length
    assert "no drive began turned by more than 0°" in began
    assert "no drive ended turned by more than 0°" in ended


def test_the_first_situation_unlike_all_others_is_drawn() -> None:
    coverage = Coverage(DRIVES.assign(x=0.0, y=0.0, yaw=0.0, xg=1.0, yg=0.0, yawg=0.0), ROBOT)
    assert coverage.distance(to(1.0, 0.0)) == 0.0
    drawn = iter([to(1.0, 0.0), to(1.2, 0.1), to(1.0, 2.0), to(9.0, 0.0)])
    sampler = Unlike(lambda *_: next(drawn), coverage)
    assert sampler(ROBOT, np.random.default_rng(0)) == to(1.0, 2.0)


def test_without_a_new_one_the_farthest_is_drawn() -> None:
    coverage = Coverage(DRIVES.assign(x=0.0, y=0.0, yaw=0.0, xg=1.0, yg=0.0, yawg=0.0), ROBOT)
    drawn = [to(1.0, 0.01 * number % 0.3) for number in range(200)]
    found = coverage.new(iter(drawn).__next__)
    assert coverage.distance(found) == max(map(coverage.distance, drawn[:51]))


def test_without_any_drive_everything_is_new() -> None:
    assert Coverage(DRIVES.iloc[:0], ROBOT).new(lambda: to(1.0, 0.0)) == to(1.0, 0.0)
