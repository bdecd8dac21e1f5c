"""Sightings of one object in order of arrival, with stamps that may be wrong."""

from __future__ import annotations

import math
from collections import deque

from ator_ros.world.plausibility import VelocityCheck
from ator_ros.world.state import ObjectState
from ator_ros.world.tracking import ObjectTracker

_KEPT = 256
_ROUNDING = 1e-6
JUMP = 20.0
"""Difference in s of two stamps that means different clocks, unless as much time has passed."""
_STALE = 1.0
"""Time in s for which all stamps must be wrong to mean another clock; after a reset some are of before."""


class StampError(ValueError):
    """An implausible stamp, whose message is ignored; the error says by how much it is off."""


class Sightings:
    """The recent sightings of one object.

    Parameters
    ----------
    name : str
        Name of the object.
    timeout : float
        Age in s, by the stamps, beyond which a sighting is not used. After half of it without a message the
        object is overdue. It may be changed later, as the attribute of this name.
    tracker : ObjectTracker
        Filters the sightings.
    """

    def __init__(self, name: str, timeout: float, tracker: ObjectTracker) -> None:
        self._name, self.timeout, self._tracker = name, timeout, tracker
        self._velocity = VelocityCheck(name, tracker.noise, tracker.velocity_noise)
        self._sights: deque[tuple[float, ObjectState]] = deque(maxlen=_KEPT)
        self._reset: float | None = -math.inf
        """Odometry's first stamp after time was reset; None: not known yet."""
        self._clear()

    def forget(self) -> None:
        """Forget the object because time was reset."""
        self._reset = None
        self._clear()

    def _clear(self) -> None:
        self._sights.clear()
        self._heard, self._stale_since = -math.inf, math.inf
        self._tracker.reset()
        self._velocity.reset()

    def overdue(self, now: float) -> bool:
        """Return whether no message has arrived for half the timeout until `now`, odometry's newest stamp."""
        return now - self._heard > self.timeout / 2.0 - _ROUNDING

    def add(self, time: float, there: ObjectState, now: float | None, pace: float = 1.0) -> str | None:
        """Process a sighting. Its stamp may be old: a late camera still works.

        Parameters
        ----------
        time : float
            Stamp of the sighting in s.
        there : ObjectState
            The object as seen.
        now : float or None
            Odometry's newest stamp in s; None before the first.
        pace : float
            Stamped s that pass in 1 real s.

        Returns
        -------
        str or None
            A warning that the velocity contradicts the positions and is not used, once per period of that.

        Raises
        ------
        StampError
            The stamp is ahead of odometry by more than twice the timeout (longer if stamps run faster than
            real time), or stamps have been far behind for a while. A stamp less far ahead is accepted:
            odometry may have paused, and will catch up. What was on its way when time was reset is not used,
            and is no error.
        """
        if now is not None:
            self._reset = now if self._reset is None else self._reset
            most = 2.0 * self.timeout * max(1.0, pace)
            if time > now + most and now - self._reset <= _STALE:
                return None
            self._check_stamp(time, now, most)
            self._heard = now
        checked, remark = self._velocity.check(time, there)
        self._sights.append((time, self._tracker.update(time, checked)))
        return remark

    def _check_stamp(self, time: float, odometry: float, most: float) -> None:
        """Check that a stamp is at most `most` s ahead of odometry, and not far behind for long."""
        if time > odometry + most:
            raise StampError(
                f"{self._name}.header.stamp: expected at most {most:g} s more than odometry's "
                f"{odometry:.2f} s, got {time:.2f} s, {time - odometry:.2f} s ahead: another clock, "
                "odometry has ceased, or this machine is too slow"
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
        """Return the newest sighting not after odometry's `time`, extrapolated to it; None if there is none.

        Messages of two topics arrive in any order, and a busy node gets only the newest of each. If the only
        recent sighting is a little newer than odometry, it is extrapolated backward.
        """
        # A sighting that arrived before odometry of its stamp counts as heard at its stamp.
        self._heard = max([self._heard, *(stamp for stamp, _ in self._sights if stamp <= time)])
        while self._sights and self._sights[0][0] < time - self.timeout:
            self._sights.popleft()
        sights = ((time - stamp, there) for stamp, there in reversed(self._sights))
        recent = [(age, there) for age, there in sights if abs(age) <= self.timeout]
        if not recent:
            return None
        age, there = min(recent, key=lambda sight: (sight[0] < 0.0, abs(sight[0])))
        return there.after(age)
