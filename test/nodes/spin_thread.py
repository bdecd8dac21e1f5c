"""A thread that spins an executor."""

from __future__ import annotations

import contextlib
import threading

from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

_SPIN = 0.1


class SpinThread(threading.Thread):
    """Spins an executor in a thread of its own.

    Shutting down an rclpy executor destroys entities that a spinning thread still uses, so the thread is
    ended first.
    """

    def __init__(self, executor: SingleThreadedExecutor) -> None:
        super().__init__(daemon=True)
        self._executor, self._ending = executor, threading.Event()

    def run(self) -> None:
        """Spin until `end` is called."""
        with contextlib.suppress(ExternalShutdownException):
            while not self._ending.is_set() and self._executor.context.ok():
                self._executor.spin_once(timeout_sec=_SPIN)

    def end(self, timeout: float | None = None) -> None:
        """Wait until the running callback has returned, at most `timeout` real s; shut the executor down."""
        self._ending.set()
        if self.is_alive():
            self.join(timeout)
        self._executor.shutdown()
