"""The time of a replay: it passes, stands, and jumps."""

from __future__ import annotations


class Player:
    """Plays something of a given duration; the caller advances time with `tick`.

    Parameters
    ----------
    duration : float
        In s.

    Attributes
    ----------
    seconds : float
        Since the begin of what is played.
    speed : float
        Played per real seconds.
    playing : bool
        Whether time passes.
    """

    def __init__(self, duration: float) -> None:
        self.duration = duration
        self.seconds, self.speed, self.playing = 0.0, 1.0, True
        self._last: float | None = None

    def tick(self, now: float) -> None:
        """Let time pass up to `now` (s, of any clock); at the end it stands."""
        passed = 0.0 if self._last is None else max(0.0, now - self._last)
        self._last = now
        if self.playing:
            self.seek(self.seconds + self.speed * passed)
            self.playing = self.seconds < self.duration

    def play(self) -> None:
        """Let time pass; at the end, from the begin on."""
        if self.seconds >= self.duration:
            self.seconds = 0.0
        self.playing = True

    def pause(self) -> None:
        """Let time stand."""
        self.playing = False

    def seek(self, seconds: float) -> None:
        """Go to a time (s), or to the nearer end."""
        self.seconds = min(max(0.0, seconds), self.duration)
