"""A thread that spins an executor, and leaves it before it is shut down."""

from __future__ import annotations

import contextlib
import threading

from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor


class Spinning:
    """Spins an executor in a thread of its own.

    An executor of rclpy that is shut down destroys what a thread that spins it still uses, and that thread
    raises. So it leaves first.

    Parameters
    ----------
    executor : SingleThreadedExecutor
        Shut down at the end.
    """

    def __init__(self, executor: SingleThreadedExecutor) -> None:
        self._executor, self._is_ending = executor, False
        self._thread = threading.Thread(target=self._spin, daemon=True)

    @property
    def goes_on(self) -> bool:
        """Whether neither an end nor an exception has ended it."""
        return self._thread.is_alive()

    def start(self) -> None:
        """Spin from now on."""
        self._thread.start()

    def _spin(self) -> None:
        with contextlib.suppress(ExternalShutdownException):
            while not self._is_ending and self._executor.context.ok():
                self._executor.spin_once()

    def end(self, patience: float | None = None) -> None:
        """Wait until the callback under way has ended, at most `patience` real s; shut the executor down."""
        if self.goes_on:
            self._executor.create_task(self._leave)
            self._thread.join(patience)
        self._executor.shutdown()

    def _leave(self) -> None:
        self._is_ending = True
