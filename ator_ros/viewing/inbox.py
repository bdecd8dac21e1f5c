"""What the clients of a view ask for, taken over by one thread."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable


class Inbox:
    """Wishes by key, first come first served; while one waits, a newer one with the same key replaces it.

    A drag gives many positions, of which only the last one counts. Any thread may put, one takes.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: dict[Hashable, Callable[[], None]] = {}

    def put(self, key: Hashable, wish: Callable[[], None]) -> None:
        """Add a wish."""
        with self._lock:
            self._waiting[key] = wish

    def take(self) -> list[Callable[[], None]]:
        """Return the wishes that wait, and forget them."""
        with self._lock:
            waiting, self._waiting = list(self._waiting.values()), {}
        return waiting
