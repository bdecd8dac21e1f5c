"""What drives have shown is counted by how they ended, and survives restarts."""

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from ator_ros.experience.server_goals import ServerGoal
from ator_ros.learning.drive_monitor import EndedDrive
from ator_ros.learning.estimates import Estimate
from ator_ros.learning.savings import RoundSavings, Saving
from ator_ros.learning.watch_tally import REMEMBERED, Tally, read_tally, save_tally
from ator_ros.refinement.gate import MeasuredGain

DAY, NEXT = "2026-01-31", "2026-02-01"
EPISODE: Any = SimpleNamespace()


def drive(status: str = "succeeded", **changes: Any) -> EndedDrive:
    """Return a drive of 10 s that was estimated to take 11 s, by its server 15 s."""
    goal = ServerGoal("visit", begin=0.0, end=10.0, status=status, server_estimates=[15.0, 13.0])
    goal.recoveries = changes.pop("recoveries", 0)
    values: dict[str, Any] = {"episode": EPISODE, "reason": ""} | changes
    return EndedDrive(goal, first=Estimate(0.0, 11.0, 1.0, 12.0, "model"), **values)


def test_drives_are_counted_by_how_they_ended() -> None:
    tally = Tally()
    drives = [
        drive(),
        drive(is_held_up=True),
        drive(recoveries=1, episode=None),
        drive("canceled", episode=None),
        drive("aborted"),
    ]
    for each in drives:
        tally.add(each, DAY)
    assert (tally.drives, tally.held_up, tally.recovered, tally.ended_early) == (1, 1, 1, 2)
    assert tally.driven == 50.0


def test_errors_are_those_of_the_first_estimate_and_of_the_server_on_the_way() -> None:
    tally = Tally()
    assert math.isnan(tally.estimate_error)
    for _ in range(REMEMBERED + 10):
        tally.add(drive(), DAY)
    assert tally.estimate_error == pytest.approx(1.0)
    assert tally.server_error == pytest.approx(4.0)
    assert len(tally.estimate_errors) == REMEMBERED


def test_savings_are_those_of_a_day() -> None:
    tally = Tally()
    for _ in range(2):
        tally.add_savings(RoundSavings(Saving(4.0, 1.0), order=Saving(30.0, 5.0)), DAY)
    assert tally.savings.headings == Saving(8.0, 2.0)
    assert "headings 8 s, order 60 s" in tally.summary("", MeasuredGain())
    tally.add(drive(), NEXT)
    assert math.isnan(tally.savings.headings.seconds)


def test_the_summary_has_the_measured_gain_of_refined_chains() -> None:
    assert "gain" not in Tally().summary("1f0c", MeasuredGain())
    measured = MeasuredGain(12, 3, predicted=2.0, mean=1.5, low=0.5, high=2.5)
    assert "refined chain: 1.50 s (0.50 to 2.50)" in Tally().summary("1f0c", measured)


def test_it_survives_a_restart(tmp_path: Path) -> None:
    tally = Tally()
    tally.add(drive(), DAY)
    tally.add_savings(RoundSavings(Saving(4.0, 1.0)), DAY)
    save_tally(tmp_path / "watch.json", tally)
    assert read_tally(tmp_path / "watch.json") == (tally, "")


def test_a_damaged_file_is_renamed(tmp_path: Path) -> None:
    (tmp_path / "watch.json").write_text("{", encoding="utf-8")
    tally, why = read_tally(tmp_path / "watch.json")
    assert tally == Tally()
    assert "renamed to" in why
    assert not (tmp_path / "watch.json").exists()
