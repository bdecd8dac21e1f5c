"""Drives that were held up: recognized, counted, and without influence on the others."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from experience_rows import dead_zone_drives, dead_zone_time, synthetic_experience
from selection import few

from ator_ros.bases.description import load_robot
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.geometry import FloatArray, wrap_angles
from ator_ros.performance.held_up import (
    NOT_HELD_UP,
    HeldUp,
    bound_of_chain,
    clipped,
    find_held_up,
    held_up_remark,
)
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.model_file import load_model, save_model
from ator_ros.performance.training import WorseThanMeanError, direct_of, train

ROBOT = load_robot()
FRESH = synthetic_experience("drive_to", episodes=200, seed=77)


def learned(rows: pd.DataFrame) -> PerformanceModel:
    return train("drive_to", rows, ROBOT, features=SOCCER.candidates("goToPose"))


def error_of(model: PerformanceModel) -> float:
    predicted = model.predict(direct_of(FRESH)).duration
    assert predicted is not None
    return float(np.abs(predicted - dead_zone_time(FRESH)).mean())


def held(rows: pd.DataFrame, *, share: float, seed: int) -> tuple[pd.DataFrame, int, float]:
    """Return drives of which a share takes 3 to 10 times as long; how many, mean delay in s."""
    rng = np.random.default_rng(seed)
    count = int(share * len(rows))
    times = np.ones(len(rows))
    times[rng.choice(len(rows), count, replace=False)] = rng.uniform(3.0, 10.0, count)
    longer = rows["duration"] * times
    delay = float((longer - rows["duration"]).sum() / max(count, 1))
    return rows.assign(duration=longer, time_to_go=longer), count, delay


@pytest.mark.parametrize("count", few([40, 100], 40))
def test_one_drive_in_ten_that_was_held_up_hardly_changes_a_model(count: int) -> None:
    before = after = 0.0
    for seed in range(3):
        rows = dead_zone_drives(count, seed=seed)
        disturbed, number, delay = held(rows, share=0.1, seed=seed)
        model = learned(disturbed)
        assert model.held_up.drives == number
        assert model.held_up.share == pytest.approx(0.1)
        assert model.held_up.delay == pytest.approx(delay, rel=0.1)
        before += error_of(learned(rows))
        after += error_of(model)
    assert after <= 1.25 * before


def test_a_server_that_waited_for_half_a_minute_was_held_up() -> None:
    rows = dead_zone_drives(60, seed=4)
    waited = rows["duration"] + 30.0 * rows["episode"].isin([7, 31])
    model = learned(rows.assign(duration=waited, time_to_go=waited))
    assert model.held_up.drives == 2
    assert model.held_up.delay == pytest.approx(30.0, abs=1.0)


@pytest.mark.parametrize("share", few([0.0, 0.08, 0.15], 0.08))
def test_nine_of_ten_drives_keep_the_bound(share: float) -> None:
    model = learned(held(dead_zone_drives(150, seed=9), share=share, seed=9)[0])
    fresh, *_ = held(dead_zone_drives(300, seed=10), share=share, seed=10)
    predicted = model.predict(direct_of(fresh), ("duration", "spread"))
    assert predicted.bound is not None
    assert 0.85 <= (fresh["duration"] <= predicted.bound).mean() <= 0.97


def test_without_delays_the_bound_of_a_chain_is_a_quantile_of_its_spread() -> None:
    bound = bound_of_chain(20.0, 2.0, [NOT_HELD_UP] * 3)
    assert bound == pytest.approx(20.0 + 1.2816 * 2.0, abs=1e-3)
    assert bound_of_chain(20.0, 0.0, []) == pytest.approx(20.0, abs=1e-3)


@pytest.mark.parametrize(("share", "delay"), [(0.02, 30.0), (0.1, 8.0), (0.3, 3.0)])
def test_nine_of_ten_chains_keep_the_bound(share: float, delay: float) -> None:
    rng = np.random.default_rng(6)
    runs = rng.normal(40.0, 1.0, 4000) + delay * (rng.random((5, 4000)) < share).sum(axis=0)
    bound = bound_of_chain(40.0, 1.0, [HeldUp(share, delay, 9, 1.0)] * 5)
    assert 0.87 <= (runs <= bound).mean() <= 0.95


def test_undisturbed_drives_are_learned_as_they_are() -> None:
    rows = dead_zone_drives(100, seed=5)
    model = learned(rows)
    assert model.held_up == NOT_HELD_UP
    assert held_up_remark("drive_to", model.held_up) == []


@pytest.mark.long
def test_drives_that_are_long_for_a_reason_are_not_held_up() -> None:
    """Where the server has to turn by more than 120° it takes more than twice as long."""
    rows = dead_zone_drives(200, seed=6)
    dx, dy = rows["xg"] - rows["x"], rows["yg"] - rows["y"]
    aside = np.abs((np.arctan2(dy, dx) - rows["yaw"] + np.pi) % (2.0 * np.pi) - np.pi)
    slow = rows["duration"] * np.where(aside > np.radians(120.0), 2.5, 1.0)
    model = learned(rows.assign(duration=slow, time_to_go=slow))
    assert model.held_up.share < 0.03
    predicted = model.predict(direct_of(rows)).duration
    assert np.abs(predicted - slow).mean() < 0.15 * slow.mean()


def turn_at_departure(rows: pd.DataFrame) -> FloatArray:
    """Return the angle in rad by which a robot must turn to face its goal."""
    to_goal = np.arctan2(rows["yg"] - rows["y"], rows["xg"] - rows["x"])
    return np.abs(wrap_angles((to_goal - rows["yaw"]).to_numpy()))


def test_where_drives_are_held_up_is_learned() -> None:
    """Before sharp turns the server waits for 20 s in 40 % of drives, and nowhere else."""
    rows = dead_zone_drives(200, seed=12)
    is_sharp = turn_at_departure(rows) > np.radians(120.0)
    waits = is_sharp & (np.random.default_rng(12).random(len(rows)) < 0.4)
    late = rows["duration"] + 20.0 * waits
    model = learned(rows.assign(duration=late, time_to_go=late))
    assert model.held_up.drives == waits.sum()
    predicted = model.predict(direct_of(FRESH), ("duration", "spread"))
    assert predicted.delay is not None
    assert predicted.bound is not None
    sharp = turn_at_departure(FRESH) > np.radians(120.0)
    assert predicted.delay[sharp].mean() == pytest.approx(0.4 * 20.0, rel=0.3)
    assert predicted.delay[~sharp].mean() < 1.0
    assert error_of(model) < 0.2  # of drives that do not wait
    beyond = predicted.bound - predicted.duration
    assert np.median(beyond[sharp]) > 20.0 > np.median(beyond[~sharp]) * 10.0


def test_delays_that_happen_anywhere_depend_on_nothing() -> None:
    model = learned(held(dead_zone_drives(200, seed=13), share=0.1, seed=13)[0])
    assert model.held_up.drives == 20
    assert model.predict(direct_of(FRESH)).delay is None


def test_a_drive_needs_to_take_half_as_long_again_as_similar_ones() -> None:
    predicted = np.full(20, 9.5)
    durations = np.full(20, 9.5)
    durations[:3] = 14.4, 14.6, 5.0  # and half a second: 10.0 and 15.0
    none = np.full(20, False)
    assert np.flatnonzero(find_held_up(durations, predicted, none)).tolist() == [1]
    left_out = none.copy()
    left_out[0] = True
    assert np.flatnonzero(find_held_up(durations, predicted, left_out)).tolist() == [0, 1]


def test_what_most_drives_do_is_no_disturbance() -> None:
    durations = np.where(np.arange(20) < 8, 40.0, 10.0)
    assert not find_held_up(durations, np.full(20, 10.0), np.full(20, False)).any()


def test_no_single_drive_is_much_longer_for_the_first_model() -> None:
    path_times = np.array([1.0, 2.0, 4.0, 2.0])
    durations = np.array([1.5, 3.0, 6.0, 300.0])
    assert clipped(durations, path_times).tolist() == [1.5, 3.0, 6.0, 2.5 * (1.5 * 2.0 + 0.5)]


def test_a_remark_names_number_share_and_delay() -> None:
    (remark,) = held_up_remark("drive_to", HeldUp(0.05, 29.83, 2))
    assert remark.startswith("drive_to: 2 drives were held up (5 %), by 29.8 s on average")


def test_a_model_that_is_worse_than_the_mean_is_rejected_if_asked() -> None:
    """The goals of three drives are in another frame."""
    rows = dead_zone_drives(60, seed=8)
    rows.loc[rows["episode"] % 20 == 3, "xg"] += 1e4
    features = SOCCER.candidates("goToPose")
    with pytest.raises(WorseThanMeanError, match="which errs by"):
        train("drive_to", rows, ROBOT, features=features, better_than_mean=True)
    assert train("drive_to", rows, ROBOT, features=features).errors is not None


def test_a_model_file_has_the_drives_that_were_held_up(tmp_path: Path) -> None:
    model = learned(held(dead_zone_drives(60, seed=11), share=0.1, seed=11)[0])
    save_model(tmp_path / "a.json", model)
    known = {feature.name: feature for feature in SOCCER.candidates("goToPose")}
    assert load_model(tmp_path / "a.json", ROBOT, known).held_up == model.held_up
    assert model.held_up.drives == 6
