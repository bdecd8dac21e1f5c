"""Path durations at observed limits: the paths, and limits estimated from odometry."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from ator_ros.performance.direct import DIRECT_VARIABLES
from ator_ros.performance.driving import DrivingStyle, ObservedLimits, plain_driving
from ator_ros.performance.features import GENERAL, IDEAL, OBSERVED, feature_table
from ator_ros.performance.model_file import load_model, save_model
from ator_ros.performance.paths import path_times
from ator_ros.performance.training import from_odometry, train
from ator_ros.robot.description import load_robot

ROBOT = load_robot()
SLOW = DrivingStyle(ObservedLimits(0.5, 1.0, 0.4, 0.3, 2.0))


def time_to(x: float, y: float, turn: float, driving: DrivingStyle, *, speed: float = 0.0) -> float:
    ends = np.array([[x, y, turn, 0.0, speed]])
    return float(path_times(ends, driving, hold=0.31, holding=False).time[0])


@pytest.mark.parametrize(("x", "y", "turn"), [(1.5, 0.8, 0.7), (-0.6, 1.1, 2.0), (0.9, -0.9, -2.4)])
def test_path_durations_are_between_straight_line_and_turn_on_the_spot(
    x: float, y: float, turn: float
) -> None:
    time = time_to(x, y, turn, SLOW)
    direct = {name: np.zeros(1) for name in DIRECT_VARIABLES} | {"xg": np.array([x]), "yg": np.array([y])}
    robot = dataclasses.replace(ROBOT, limits=SLOW.limits)
    stops = feature_table({**direct, "yawg": np.array([turn])}, robot, IDEAL).min()
    assert math.hypot(x, y) / 0.5 < time < stops + 0.05


def test_paths_avoid_an_object_at_the_goal() -> None:
    ends = np.array([[1.5, 0.0, math.pi, 0.0, 0.0]])
    free = dataclasses.replace(SLOW, run=0.2)
    around = dataclasses.replace(free, passing=1.0)
    times = [path_times(ends, driving, hold=0.31, holding=True).time[0] for driving in (free, around)]
    assert times[1] > times[0] + 0.1


def episodes(count: int = 40) -> pd.DataFrame:
    """Return drives straight ahead at 0.4 m/s, with a turn at 0.8 rad/s at the end of each."""
    rows = []
    for number in range(count):
        length = 0.5 + 0.05 * number
        times = np.arange(0.0, 2.0 + length / 0.4 + 1.0, 0.1)
        speed = np.clip(np.minimum(0.2 * times, 0.4), 0.0, np.maximum(0.0, 0.1 * (times[-1] - times)))
        for time, v in zip(times, speed, strict=True):
            row = dict.fromkeys(DIRECT_VARIABLES, 0.0) | {"v": v, "xg": length}
            row |= {"w": 0.8 if v > 0.35 else 0.0, "t": round(time, 1), "episode": number, "action": "drive"}
            left = times[-1] - time
            row |= {"time_to_go": left, "duration": times[-1], "success": True}
            rows.append(row | {"position_error": 0.0, "heading_error": 0.0})
    return pd.DataFrame(rows)


def test_limits_are_estimated_from_odometry() -> None:
    style = from_odometry(episodes(), ROBOT)
    assert style.limits.v == pytest.approx(0.4, abs=0.01)
    assert style.limits.w == pytest.approx(0.8, abs=0.01)
    assert style.limits.a == pytest.approx(0.2, rel=0.05)
    assert style.limits.brake == pytest.approx(0.1, rel=0.05)
    assert not style.backward


def test_a_model_stores_the_driving_style_of_its_action(tmp_path: Path) -> None:
    model = train("drive", episodes(), ROBOT, features=OBSERVED)
    assert model.driving is not None
    save_model(tmp_path / "drive.json", model)
    read = load_model(tmp_path / "drive.json", ROBOT, GENERAL)
    assert read.driving == model.driving
    assert read.driving != plain_driving(ROBOT)
    direct = dict.fromkeys(DIRECT_VARIABLES, 0.1) | {"xg": 2.0}
    again, once = read.predict(direct).duration, model.predict(direct).duration
    assert again is not None
    assert once is not None
    assert np.array_equal(again, once)
