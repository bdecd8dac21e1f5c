"""Configuration and fixtures of all tests."""

import signal
from collections.abc import Iterator

import pytest


def pytest_configure() -> None:
    """Restore default signal handlers: background jobs of a shell ignore SIGINT, and under nohup SIGHUP.

    Child processes inherit ignored signals.
    """
    for number, handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, handler)


@pytest.fixture(autouse=True)
def signals_as_before() -> Iterator[None]:
    """Fail a test that changes signal handlers, since later commands could not be stopped."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.getsignal(number) for number in numbers}
    yield
    after = {number: signal.getsignal(number) for number in numbers}
    for number, handler in before.items():
        signal.signal(number, handler)
    assert after == before
