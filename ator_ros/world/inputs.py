"""Odometry and ball, which come as messages of their own, joined to the state of the world (without ROS)."""

from __future__ import annotations

import math
from collections import deque

from ator_ros.world.plausibility import VelocityCheck
from ator_ros.world.state import BallState, RobotState, World
from ator_ros.world.tracking import BallTracker

_BALLS_KEPT = 256
_ROUNDING = 1e-6
_JUMP = 20.0
"""Time in s between two stamps that is another clock's, if it came at once."""
_FASTEST = 1000.0
"""Simulated seconds in a real one that are believed besides: simulations run at a few hundred."""
_LONGEST = 1.0
"""Real s of a silence in which simulated time is believed to have passed so fast."""
_STALE = 1.0
"""Time in s for which all sights must be old before their clock is blamed: after a reset some are."""


class StampError(ValueError):
    """A message whose stamp cannot be right, and which is ignored; the message says by how much it is off."""


class ClockJumpError(ValueError):
    """Odometry whose clock has jumped, as after a reset; the message gives both times.

    Attributes
    ----------
    back : bool
        Whether it went back.
    """

    def __init__(self, message: str, *, back: bool) -> None:
        super().__init__(message)
        self.back = back


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
        self._velocity = VelocityCheck(tracker.noise, tracker.velocity_noise)
        self._balls: deque[tuple[float, BallState]] = deque(maxlen=_BALLS_KEPT)
        self._time: float | None = None
        self._ahead: float | None = None
        self._came = 0.0
        self._forget()

    def _forget(self) -> None:
        """Forget the ball, as time begins anew."""
        self._balls.clear()
        self._ball_heard, self._stale_since = -math.inf, math.inf
        self._tracker.reset()
        self._velocity.reset()

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

    def ball(self, time: float, ball: BallState) -> str | None:
        """Take a ball with its stamp in s, which may be old: a camera is late, and yet alive.

        Returns
        -------
        str or None
            That its velocity contradicts its positions, and is not trusted; once for each such spell.

        Raises
        ------
        StampError
            The stamp is ahead of odometry by more than twice `ball_timeout`, or all have long been behind. By
            less it may be ahead, as odometry may have paused; the ball is used when that has come.
        """
        if self._time is not None:
            self._check_ball_stamp(time, self._time)
            self._ball_heard = self._time
        checked, remark = self._velocity.check(time, ball)
        self._balls.append((time, self._tracker.update(time, checked)))
        return remark

    def _check_ball_stamp(self, time: float, odometry: float) -> None:
        most = 2.0 * self._ball_timeout
        if time > odometry + most:
            raise StampError(
                f"ball.header.stamp: expected at most {most:g} s more than odometry's {odometry:.2f} s, "
                f"got {time:.2f} s, {time - odometry:.2f} s ahead: another clock, or odometry has ceased"
            )
        if time >= odometry - _JUMP:
            self._stale_since = math.inf
            return
        self._stale_since = min(self._stale_since, odometry)
        if odometry - self._stale_since > _STALE:
            raise StampError(
                f"ball.header.stamp: expected about odometry's {odometry:.2f} s, got {time:.2f} s, "
                f"{odometry - time:.2f} s behind: another clock"
            )

    def robot(self, time: float, robot: RobotState, now: float = 0.0) -> World | None:
        """Take the robot's state with its stamp in s; return the world, or None if no time has passed.

        `now` is the real time in s: between messages that come late, the stamps may advance far.

        Raises
        ------
        StampError
            The stamp is far ahead of the one before: the message is ignored, unless the next one confirms it.
        ClockJumpError
            The stamp is older than the one before, or the second one far ahead. What was known is forgotten:
            the next stamp counts.
        """
        last, most = self._time, _JUMP + _FASTEST * min(now - self._came, _LONGEST)
        self._came = now
        self._check_stamp(time, last, most)
        self._time, self._ahead = time, None
        # A ball that came before odometry of its time was heard at that time.
        self._ball_heard = max([self._ball_heard, *(stamp for stamp, _ in self._balls if stamp <= time)])
        while self._balls and self._balls[0][0] < time - self._ball_timeout:
            self._balls.popleft()
        return None if time == last else World(time, robot, self._ball_at(time))

    def _check_stamp(self, time: float, last: float | None, most: float) -> None:
        """Make sure that odometry's clock goes on from `last`, by at most `most` s."""
        if last is None or 0.0 <= time - last <= most:
            return
        confirmed = self._ahead is not None and 0.0 <= time - self._ahead <= most
        if time > last and not confirmed:
            self._ahead = time
            raise StampError(
                f"odom.header.stamp: expected soon after {last:.2f} s, got {time:.2f} s, "
                f"{time - last:.2f} s ahead: another clock, or odometry had ceased"
            )
        self._time, self._ahead = time, None
        self._forget()
        if time > last:
            raise ClockJumpError(
                f"time jumped {time - last:.2f} s ahead: expected odometry soon after {last:.2f} s, got "
                f"{time:.2f} s: another clock, or odometry had ceased",
                back=False,
            )
        raise ClockJumpError(
            f"time went back {last - time:.2f} s: expected odometry after {last:.2f} s, got {time:.2f} s: "
            "was there a reset, or do two nodes publish it?",
            back=True,
        )

    def _ball_at(self, time: float) -> BallState | None:
        """Return the newest ball that is not newer than `time`, carried on to it by its velocity.

        Two topics have no common order, and only the newest message of each is kept for a node that was
        busy: where the only recent ball is a little newer than odometry, it is carried back.
        """
        sights = ((time - stamp, ball) for stamp, ball in reversed(self._balls))
        recent = [(age, ball) for age, ball in sights if abs(age) <= self._ball_timeout]
        if not recent:
            return None
        age, ball = min(recent, key=lambda sight: (sight[0] < 0.0, abs(sight[0])))
        return ball.after(age)
