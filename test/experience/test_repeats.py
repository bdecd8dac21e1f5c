"""Drives that several sources contain count once."""

import numpy as np
import pandas as pd
from experience_rows import whole_drives

from ator_ros.experience.repeats import without_repeats
from ator_ros.experience.table import count_episodes, join

DRIVES, _ = whole_drives(6, seed=3, noise=0.1)
DRIVES["action"] = "goToPose"


def beside(*tables: pd.DataFrame) -> pd.DataFrame:
    """Return tables as one, with episodes of different numbers."""
    shifted = [table.assign(episode=table["episode"] + 100 * n) for n, table in enumerate(tables)]
    return join(shifted)


def end_of(drive: pd.DataFrame, first: int) -> pd.DataFrame:
    """Return what a recording holds that began at the row `first` of a drive."""
    end = drive.iloc[first:]
    return end.assign(t=end["t"] - end["t"].iloc[0], duration=end["time_to_go"].iloc[0])


def test_shifted_stamps_change_only_last_digits() -> None:
    digits = np.random.default_rng(0).uniform(-2e-6, 2e-6, (3, len(DRIVES)))
    other = DRIVES.assign(
        x=DRIVES["x"] + digits[0],
        time_to_go=DRIVES["time_to_go"] + digits[1],
        duration=DRIVES["duration"] + 3e-7,
        yaw=DRIVES["yaw"] + 2.0 * np.pi,
    )
    pd.testing.assert_frame_equal(without_repeats(beside(DRIVES, other)), join([DRIVES]))


def test_a_drive_and_its_end_count_once() -> None:
    first = DRIVES[DRIVES["episode"] == 0]
    driving = int(np.flatnonzero(first["v"] > 0.0)[3])
    end = end_of(first, driving)
    assert end["v"].iloc[0] > 0.0
    for tables in ((DRIVES, end), (end, DRIVES)):
        once = without_repeats(beside(*tables))
        assert count_episodes(once) == 6
        assert once["duration"].max() == DRIVES["duration"].max()
        assert len(once) == len(DRIVES)


def test_another_drive_to_the_same_goal_counts() -> None:
    first = DRIVES[DRIVES["episode"] == 0]
    driving = int(np.flatnonzero(first["v"] > 0.0)[3])
    other = end_of(first, driving)
    beside_it = other.assign(x=other["x"] + 0.3)
    later = other.assign(duration=other["duration"] + 0.5, time_to_go=other["time_to_go"] + 0.5)
    assert count_episodes(without_repeats(beside(DRIVES, beside_it, later))) == 8


def test_thirty_equal_drives_are_one() -> None:
    first = DRIVES[DRIVES["episode"] == 0]
    assert count_episodes(without_repeats(beside(*[first] * 30))) == 1


def test_drives_of_different_durations_differ() -> None:
    first = DRIVES[DRIVES["episode"] == 0]
    slower = first.assign(duration=first["duration"] + 0.05)
    assert count_episodes(without_repeats(beside(first, slower))) == 2
