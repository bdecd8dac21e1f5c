"""Phases, endings and deadlines of the execution of a goal."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from ator_ros.actions import TIME_LIMIT

WATCH_PERIOD = 0.05
"""Real time in s between two checks of the deadlines."""

LONGEST_STOP_DELAY = 5.0
"""Greatest factor by which a slow clock delays the command to stand. After a pause of some seconds a clock
seems up to 50 times slower than real time; the end of a goal may wait that long, a moving robot must not."""


class Ending(enum.Enum):
    """How a goal ended; names and values are those of Outcome.msg."""

    SUCCEEDED = 1
    FAILED = 2
    REFUSED = 3
    CANCELED = 4
    PREEMPTED = 5
    INPUT_LOST = 6
    SHUTDOWN = 7
    OBJECT_LOST = 8
    BASE_FAULT = 9
    OUT_OF_BOUNDS = 10


class Phase(enum.Enum):
    """Phase of the execution of a goal."""

    WAITING = "waiting for the first state"
    REFINING = "waiting for refinement"
    EXECUTING = "executing"
    STOPPING = "stopping"
    ENDED = "ended"


@dataclass(frozen=True, slots=True)
class Deadlines:
    """Times after which waiting ends.

    Attributes
    ----------
    start : float
        Real time in s from the goal's acceptance until everything that its chain needs is known.
    odom : float
        Real time in s without newer odometry, once there was some.
    refinement : float
        Real time in s that refinement may take.
    action : float
        Time in s on odometry's clock that one step may take, including all changes of its goal.
    """

    start: float = 2.0
    odom: float = 0.3
    refinement: float = 0.5
    action: float = TIME_LIMIT

    @property
    def silence(self) -> float:
        """Real time in s without newer odometry after which the robot should stand."""
        return self.odom / 2.0

    @property
    def longest_gap(self) -> float:
        """Greatest real time in s from the last odometry until the robot is commanded to stand."""
        return self.silence + WATCH_PERIOD
