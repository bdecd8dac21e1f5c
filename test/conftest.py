"""What all tests need."""

from __future__ import annotations

import signal


def pytest_configure() -> None:
    """Take Ctrl-C as usual: what a shell starts in the background ignores it, and children inherit that."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
