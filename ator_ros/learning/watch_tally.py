"""What the watched drives have shown so far, in a file that survives restarts."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated

import numpy as np

from ator_ros.experience.server_goals import LOST
from ator_ros.files import DamagedFileError, FileError, load, save, set_aside
from ator_ros.learning.drive_monitor import EndedDrive
from ator_ros.learning.savings import RoundSavings, Saving
from ator_ros.learning.sets import Count
from ator_ros.refinement.gate import MeasuredGain
from ator_ros.schema import Within

KIND = "watched drives"
TALLY = "watch.json"
"""The file in the folder of the node `watch`."""
REMEMBERED = 50
"""Newest arrived drives whose errors count."""
_DAY = 86_400.0  # s
Seconds = Annotated[float, Within(0.0, _DAY)]


@dataclass
class Tally:
    """The fields of the file `TALLY`.

    Attributes
    ----------
    drives, held_up, recovered, ended_early : int
        Undisturbed drives; those that took much longer; those with recoveries; canceled, preempted,
        aborted or lost ones.
    day : str
        The day of `driven` and `saved`, as in 2026-01-31.
    driven : float
        Time in s that the robot has driven on that day.
    saved : dict
        What rounds of that day would have saved, by what: seconds, and half of the 95 % interval.
    estimate_errors : list of float
        Absolute errors in s of the first estimates of the newest arrived drives, oldest first.
    server_errors : list of float
        Mean absolute errors in s of the server's own estimates in each of these drives; a drive
        without an estimate has none.
    """

    drives: Count = 0
    held_up: Count = 0
    recovered: Count = 0
    ended_early: Count = 0
    day: str = ""
    driven: Seconds = 0.0
    saved: dict[str, tuple[Seconds, Seconds]] = field(default_factory=dict)
    estimate_errors: list[Seconds] = field(default_factory=list)
    server_errors: list[Seconds] = field(default_factory=list)

    def add(self, drive: EndedDrive, day: str) -> None:
        """Count a drive that has ended on a day, as in 2026-01-31."""
        goal = drive.goal
        self._begin(day)
        if math.isfinite(drive.duration):
            self.driven = min(self.driven + max(0.0, drive.duration), _DAY)
        if goal.status in ("canceled", "aborted", LOST) and not goal.is_passed:
            self.ended_early += 1
        elif goal.is_recovered:
            self.recovered += 1
        elif drive.is_held_up:
            self.held_up += 1
        elif drive.episode is not None:
            self.drives += 1
            if not goal.is_passed:  # estimates were for a stop
                self._add_errors(drive)

    def _begin(self, day: str) -> None:
        if day != self.day:
            self.day = day
            self.driven = 0.0
            self.saved = {}

    @property
    def savings(self) -> RoundSavings:
        """What the rounds of the day would have saved."""
        return RoundSavings(**{name: Saving(*values) for name, values in self.saved.items()})

    def add_savings(self, found: RoundSavings, day: str) -> None:
        """Add what a round would have saved that was driven on a day."""
        self._begin(day)
        total = self.savings.plus(found)
        for item in fields(total):
            saving = getattr(total, item.name)
            if math.isfinite(saving.seconds) and math.isfinite(saving.half):
                limited = min(saving.seconds, _DAY), min(saving.half, _DAY)
                self.saved[item.name] = limited

    def _add_errors(self, drive: EndedDrive) -> None:
        if drive.first is not None:
            error = abs(drive.first.total - drive.duration)
            self.estimate_errors = [*self.estimate_errors, error][-REMEMBERED:]
        estimates = np.array(drive.goal.server_estimates)
        if len(estimates):
            error = float(np.mean(np.abs(estimates - drive.duration)))
            self.server_errors = [*self.server_errors, min(error, _DAY)][-REMEMBERED:]

    @property
    def estimate_error(self) -> float:
        """Mean absolute error in s of the first estimates; NaN without one."""
        return _mean(self.estimate_errors)

    @property
    def server_error(self) -> float:
        """Mean absolute error in s of the server's own estimates; NaN without one."""
        return _mean(self.server_errors)

    def summary(self, models: str, refined: MeasuredGain) -> str:
        """Return in a sentence what drives have shown, and what refining chains has gained.

        `models` is the digest of those in use, empty without any.
        """
        others = {
            "held up": self.held_up,
            "with recoveries": self.recovered,
            "ended early": self.ended_early,
        }
        beside = "".join(f", {count} {name}" for name, count in others.items() if count)
        text = f"{self.drives} drives to learn from{beside}"
        if self.estimate_errors:
            text += (
                f"; first estimates of the last {len(self.estimate_errors)} were wrong by "
                f"{self.estimate_error:.2f} s on average"
            )
        if self.server_errors:
            text += f", the server's own on the way by {self.server_error:.2f} s"
        gains = [f"{name} {values[0]:.0f} s" for name, values in self.saved.items()]
        if gains:
            text += f"; would have saved of {self.driven:.0f} s driven today: {', '.join(gains)}"
        if refined.refined:
            text += f"; measured gain per refined chain: {refined}"
        return f"{text}; {f'models {models}' if models else 'no model yet'}"


def read_tally(file: Path) -> tuple[Tally, str]:
    """Return the tally in a file, and what was wrong with it; a new one without a usable file.

    A damaged file is renamed. Raises OSError if the folder cannot be read or written.
    """
    if not file.exists():
        return Tally(), ""
    try:
        return load(file, KIND, Tally), ""
    except DamagedFileError as error:
        return Tally(), f"{error}; renamed to {set_aside(file).name}"


def drives_elsewhere(folder: Path) -> int:
    """Return how many drives the folders beside a folder have, with other parameters of Nav2."""
    found = 0
    for file in folder.parent.glob(f"*/{TALLY}"):
        if file.parent != folder:
            with contextlib.suppress(FileError, OSError):
                found += load(file, KIND, Tally).drives
    return found


def save_tally(file: Path, tally: Tally) -> None:
    """Write a tally to a file; raises OSError."""
    save(file, KIND, tally)


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else math.nan
