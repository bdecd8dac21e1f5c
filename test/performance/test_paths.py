"""Times of paths: limits and turns by odometry, and the driving style that a model stores."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from ator_ros.bases.description import load_robot
from ator_ros.bases.differential.driving import DrivingStyle, plain_driving
from ator_ros.bases.differential.limits import Limits
from ator_ros.bases.differential.observation import observed_driving
from ator_ros.bases.differential.shapes import fastest_paths
from ator_ros.bases.direct import DIRECT_VARIABLES
from ator_ros.bases.drive_parts import DriveParts
from ator_ros.performance.features import GENERAL, PATHS, feature_table
from ator_ros.performance.model_file import load_model, save_model
from ator_ros.performance.training import train

ROBOT = load_robot()
SLOW = DrivingStyle(Limits(0.5, 1.0, 0.4, 0.3, 2.0), plain_driving(ROBOT.limits).drives)


def time_to(x: float, y: float, turn: float, driving: DrivingStyle, *, hold: float = 0.0) -> float:
    direct = dict.fromkeys(DIRECT_VARIABLES, 0.0) | {"xg": x, "yg": y, "yawg": turn, "hold": hold}
    return float(feature_table(direct, ROBOT, PATHS, driving)[0, 0])


@pytest.mark.parametrize(("x", "y", "turn"), [(1.5, 0.8, 0.7), (-0.6, 1.1, 2.0), (0.9, -0.9, -2.4)])
def test_no_path_is_faster_than_the_limits_allow(x: float, y: float, turn: float) -> None:
    slow, usual = (
        time_to(x, y, turn, dataclasses.replace(plain_driving(robot.limits), limits=limits))
        for robot, limits in ((ROBOT, SLOW.limits), (ROBOT, plain_driving(ROBOT.limits).limits))
    )
    assert slow > math.hypot(x, y) / SLOW.limits.v
    assert usual > math.hypot(x, y) / ROBOT.limits.v


def test_paths_do_not_lead_over_an_object_at_the_goal() -> None:
    plain = plain_driving(ROBOT.limits)
    through = dataclasses.replace(plain, approaches=plain.drives, run=0.2)
    around = dataclasses.replace(through, passing=0.5)
    x, y, heading = np.random.default_rng(3).uniform(-1.0, 1.0, (3, 200)) * [
        [3.0],
        [3.0],
        [math.pi],
    ]
    direct = {
        **dict.fromkeys(DIRECT_VARIABLES, 0.0),
        "xg": x,
        "yg": y,
        "yawg": heading,
        "hold": 1.0,
    }
    times = [feature_table(direct, ROBOT, PATHS, driving)[:, 0] for driving in (through, around)]
    assert (times[1] > times[0] - 1e-9).all()
    assert np.mean(times[1] > times[0] + 0.1) > 0.05


@pytest.mark.parametrize("row", range(5))
def test_a_path_with_an_unknown_end_has_no_effect_on_others(row: int) -> None:
    shapes = plain_driving(ROBOT.limits).drive_paths
    ends = np.random.default_rng(4).uniform(-1.0, 1.0, (5, 130))
    expected = fastest_paths(ends, shapes, hold=0.0)
    expected[:, 40:100] = np.array(shapes.missed)[:, None]
    ends[row, 40:100] = math.nan
    assert (fastest_paths(ends, shapes, hold=0.0) == expected).all()


def test_the_path_of_a_pair_of_ends_does_not_depend_on_other_pairs() -> None:
    shapes = plain_driving(ROBOT.limits).drive_paths
    ends = np.random.default_rng(5).uniform(-1.0, 1.0, (5, 200)) * [
        [3.0],
        [3.0],
        [math.pi],
        [0.8],
        [0.8],
    ]
    paths = fastest_paths(ends, shapes, hold=0.0)
    assert (fastest_paths(ends[:, ::-1], shapes, hold=0.0) == paths[:, ::-1]).all()
    parts = np.split(ends, [0, 1, 64, 129], axis=1)
    assert (np.hstack([fastest_paths(part, shapes, hold=0.0) for part in parts]) == paths).all()


def episodes() -> pd.DataFrame:
    """Return drives straight ahead at 0.4 m/s, with a turn at that speed in the middle of each."""
    rows = []
    for number in range(40):
        length = 0.5 + 0.05 * number
        times = np.arange(0.0, 2.0 + length / 0.4 + 1.0, 0.1)
        speed = np.clip(
            np.minimum(0.2 * times, 0.4), 0.0, np.maximum(0.0, 0.1 * (times[-1] - times))
        )
        for time, v in zip(times, speed, strict=True):
            row = dict.fromkeys(DIRECT_VARIABLES, 0.0) | {"v": v, "xg": length}
            turning = 0.8 if v > 0.35 else 0.0
            row |= {"w": turning, "t": round(time, 1), "episode": number, "action": "drive"}
            left = times[-1] - time
            row |= {"time_to_go": left, "duration": times[-1], "success": True}
            rows.append(
                row | {"position_error": 0.0, "heading_error": 0.0} | DriveParts()._asdict()
            )
    return pd.DataFrame(rows)


def test_limits_are_read_from_odometry() -> None:
    observed = observed_driving(episodes(), ROBOT)
    assert observed.limits.v == pytest.approx(0.4, abs=0.01)
    assert observed.limits.w == pytest.approx(0.8, abs=0.01)
    assert observed.limits.a == pytest.approx(0.2, rel=0.05)
    assert observed.limits.brake == pytest.approx(0.1, rel=0.05)
    assert observed.forward
    glitches = episodes().assign(v=lambda rows: rows["v"].where(rows.index % 100 > 0, 1000.0))
    driving = train("drive", glitches, ROBOT).driving
    assert driving.limits.v == 20.0


def test_paths_contain_only_turns_that_the_action_has_made() -> None:
    observed = observed_driving(episodes(), ROBOT)
    able = dataclasses.replace(observed, drives=plain_driving(ROBOT.limits).drives, forward=False)
    # The action has never turned on the spot, so its path to a goal behind it is a wide turn.
    assert time_to(-1.0, 0.0, math.pi, observed) > time_to(-1.0, 0.0, math.pi, able) + 1.0


def test_paths_of_an_action_that_ends_at_any_heading_have_no_last_turn() -> None:
    observed = observed_driving(episodes().assign(heading_error=np.nan), ROBOT)
    turns = observed_driving(episodes(), ROBOT)
    assert observed.free_heading
    assert not turns.free_heading
    times = [time_to(2.0, 1.0, yaw, observed) for yaw in (-2.0, 0.0, 0.5, 3.0)]
    assert max(times) == min(times) < min(time_to(2.0, 1.0, yaw, turns) for yaw in (-2.0, 0.0, 3.0))
    # The held object arrives at the goal: the robot stops before it.
    held = [time_to(2.0, 0.0, yaw, observed, hold=1.0) for yaw in (-2.0, 0.0, 3.0)]
    assert max(held) == pytest.approx(min(held))
    assert held[0] == pytest.approx(time_to(2.0 - ROBOT.hold, 0.0, 0.0, observed))


def test_starts_alone_show_no_limits() -> None:
    rows = episodes()
    assert observed_driving(rows[rows["t"] == 0.0], ROBOT) == plain_driving(ROBOT.limits)


def test_a_model_keeps_how_its_action_drives(tmp_path: Path) -> None:
    model = train("drive", episodes(), ROBOT)
    assert model.driving is not None
    save_model(tmp_path / "drive.json", model)
    read = load_model(tmp_path / "drive.json", ROBOT, GENERAL)
    assert read.driving == model.driving
    direct = dict.fromkeys(DIRECT_VARIABLES, 0.1) | {"xg": 2.0}
    again, once = read.predict(direct).duration, model.predict(direct).duration
    assert again is not None
    assert once is not None
    assert np.array_equal(again, once)
