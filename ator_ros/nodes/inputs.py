"""Odometry and ball, which come as messages of their own, joined to the state of the world (without ROS)."""

from __future__ import annotations

import math
from collections import deque

from ator_ros.tracking import BallTracker
from ator_ros.world import BallState, RobotState, World

_BALLS_KEPT = 256
_ROUNDING = 1e-6


class TimeWentBackError(ValueError):
    """Odometry that is older than the last one, as after a reset; the message gives both times."""


class BallAheadError(ValueError):
    """A ball whose stamp is far ahead of odometry, and ignored; the message says by how much."""


class Inputs:
    """The newest state of the robot, with the ball of the same time.

    Parameters
    ----------
    ball_timeout : float
        Time in s, of the messages' stamps, after which a ball counts as unknown; after half of it without
        any message of the ball, one is overdue.
    tracker : BallTracker
        Makes the most of noisy sights of the ball.
    """

    def __init__(self, ball_timeout: float, tracker: BallTracker) -> None:
        self._ball_timeout = ball_timeout
        self._tracker = tracker
        self._balls: deque[tuple[float, BallState]] = deque(maxlen=_BALLS_KEPT)
        self._time: float | None = None
        self._ball_heard = -math.inf

    @property
    def ball_overdue(self) -> bool:
        """Whether nothing has come of the ball for so long that the robot should rather stand."""
        if self._time is None:
            return True
        return self._time - self._ball_heard > self._ball_timeout / 2.0 - _ROUNDING

    @property
    def time(self) -> float | None:
        """Stamp of the newest odometry in s; None when there was none."""
        return self._time

    def ball(self, time: float, ball: BallState) -> None:
        """Take a ball with its stamp in s, which may be old: a camera is late, and yet alive.

        Raises
        ------
        BallAheadError
            The stamp is ahead of odometry by more than twice `ball_timeout`. By less it may be, as odometry
            may have paused; the ball is used when that has come.
        """
        if self._time is not None:
            most = 2.0 * self._ball_timeout
            if time > self._time + most:
                raise BallAheadError(
                    f"ball.header.stamp: expected at most {most:g} s more than odometry's "
                    f"{self._time:.2f} s, got {time:.2f} s: another clock, or odometry has ceased"
                )
            self._ball_heard = self._time
        self._balls.append((time, self._tracker.update(time, ball)))

    def robot(self, time: float, robot: RobotState) -> World | None:
        """Take the robot's state with its stamp in s; give the world, or None if no time has passed.

        Raises
        ------
        TimeWentBackError
            The stamp is older than the one before. What was known is forgotten: the next stamp counts.
        """
        last, self._time = self._time, time
        if last is not None and time < last:
            self._balls.clear()
            self._ball_heard = -math.inf
            self._tracker.reset()
            raise TimeWentBackError(
                f"expected odometry after {last:.2f} s, got {time:.2f} s: was there a reset, or "
                "do two nodes publish it?"
            )
        # A ball that came before odometry of its time was heard at that time.
        self._ball_heard = max([self._ball_heard, *(stamp for stamp, _ in self._balls if stamp <= time)])
        while self._balls and self._balls[0][0] < time - self._ball_timeout:
            self._balls.popleft()
        return None if time == last else World(time, robot, self._ball_at(time))

    def _ball_at(self, time: float) -> BallState | None:
        """Give the newest ball that is not newer than `time`, carried on to it by its velocity.

        Two topics have no common order, and only the newest message of each is kept for a node that was
        busy: where the only recent ball is a little newer than odometry, it is carried back.
        """
        sights = ((time - stamp, ball) for stamp, ball in reversed(self._balls))
        recent = [(age, ball) for age, ball in sights if abs(age) <= self._ball_timeout]
        if not recent:
            return None
        age, ball = min(recent, key=lambda sight: (sight[0] < 0.0, abs(sight[0])))
        return ball.after(age)
