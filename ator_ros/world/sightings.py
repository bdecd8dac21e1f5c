"""What is heard of one object: its sights in the order of their coming, with stamps that may lie."""

from __future__ import annotations

import math
from collections import deque

from ator_ros.world.plausibility import VelocityCheck
from ator_ros.world.state import ObjectState
from ator_ros.world.tracking import ObjectTracker

_KEPT = 256
_ROUNDING = 1e-6
JUMP = 20.0
"""Time in s between two stamps that is another clock's, if it came at once."""
_STALE = 1.0
"""Time in s for which all sights must be old before their clock is blamed: after a reset some are."""


class StampError(ValueError):
    """A message whose stamp cannot be right, and which is ignored; the message says by how much it is off."""


class Sightings:
    """The recent sights of one object.

    Parameters
    ----------
    name : str
        Name of the object.
    timeout : float
        Time in s, of the messages' stamps, after which the object counts as unknown; after half of it without
        any message of it, one is overdue.
    tracker : ObjectTracker
        Makes the most of noisy sights.
    """

    def __init__(self, name: str, timeout: float, tracker: ObjectTracker) -> None:
        self._name, self._timeout, self._tracker = name, timeout, tracker
        self._velocity = VelocityCheck(name, tracker.noise, tracker.velocity_noise)
        self._sights: deque[tuple[float, ObjectState]] = deque(maxlen=_KEPT)
        self.forget()

    def forget(self) -> None:
        """Forget the object, as time begins anew."""
        self._sights.clear()
        self._heard, self._stale_since = -math.inf, math.inf
        self._tracker.reset()
        self._velocity.reset()

    def overdue(self, now: float) -> bool:
        """Return whether at `now`, odometry's newest stamp, nothing has come for half the timeout."""
        return now - self._heard > self._timeout / 2.0 - _ROUNDING

    def add(self, time: float, there: ObjectState, now: float | None) -> str | None:
        """Take a sight with its stamp in s, which may be old: a camera is late, and yet alive.

        Parameters
        ----------
        time : float
            Its stamp.
        there : ObjectState
            Where the object was seen.
        now : float or None
            Odometry's newest stamp; None before there is one.

        Returns
        -------
        str or None
            That its velocity contradicts its positions, and is not trusted; once for each such spell.

        Raises
        ------
        StampError
            The stamp is ahead of odometry by more than twice the timeout, or all have long been behind. By
            less it may be ahead, as odometry may have paused; the sight is used when that has come.
        """
        if now is not None:
            self._check_stamp(time, now)
            self._heard = now
        checked, remark = self._velocity.check(time, there)
        self._sights.append((time, self._tracker.update(time, checked)))
        return remark

    def _check_stamp(self, time: float, odometry: float) -> None:
        most = 2.0 * self._timeout
        if time > odometry + most:
            raise StampError(
                f"{self._name}.header.stamp: expected at most {most:g} s more than odometry's "
                f"{odometry:.2f} s, got {time:.2f} s, {time - odometry:.2f} s ahead: another clock, "
                "or odometry has ceased"
            )
        if time >= odometry - JUMP:
            self._stale_since = math.inf
            return
        self._stale_since = min(self._stale_since, odometry)
        if odometry - self._stale_since > _STALE:
            raise StampError(
                f"{self._name}.header.stamp: expected about odometry's {odometry:.2f} s, got {time:.2f} s, "
                f"{odometry - time:.2f} s behind: another clock"
            )

    def at(self, time: float) -> ObjectState | None:
        """Return the newest sight that is not newer than odometry's `time`, carried on to it by its velocity.

        Two topics have no common order, and only the newest message of each is kept for a node that was
        busy: where the only recent sight is a little newer than odometry, it is carried back.
        """
        # A sight that came before odometry of its time was heard at that time.
        self._heard = max([self._heard, *(stamp for stamp, _ in self._sights if stamp <= time)])
        while self._sights and self._sights[0][0] < time - self._timeout:
            self._sights.popleft()
        sights = ((time - stamp, there) for stamp, there in reversed(self._sights))
        recent = [(age, there) for age, there in sights if abs(age) <= self._timeout]
        if not recent:
            return None
        age, there = min(recent, key=lambda sight: (sight[0] < 0.0, abs(sight[0])))
        return there.after(age)
