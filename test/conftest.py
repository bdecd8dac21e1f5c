"""What all tests need."""

from __future__ import annotations

import signal


def pytest_configure() -> None:
    """Take signals as usual: what a shell starts in the background ignores Ctrl-C, under nohup also SIGHUP.

    Children inherit that.
    """
    for number, handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, handler)
