"""Configuration and fixtures of all tests."""

import signal
from collections.abc import Iterator

import pytest

_LONG = ("learning", "tools", "test")
"""Folders of files that take long."""


def pytest_configure() -> None:
    """Restore default signal handlers: background jobs ignore SIGINT, and under nohup SIGHUP.

    Child processes inherit ignored signals.
    """
    for number, handler in (
        (signal.SIGINT, signal.default_int_handler),
        (signal.SIGHUP, signal.SIG_DFL),
    ):
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, handler)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mix files with nodes, which often wait, and others, those with long tests first.

    So two workers seldom start nodes at the same time, and they end at about the same time.
    """
    files = sorted(
        dict.fromkeys(item.path for item in items), key=lambda file: file.parent.name not in _LONG
    )
    place = {}
    for nodes in (True, False):
        part = [file for file in files if (file.parent.name == "nodes") is nodes]
        place |= {file: (at + 0.5) / len(part) for at, file in enumerate(part)}
    items.sort(key=lambda item: place[item.path])


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
