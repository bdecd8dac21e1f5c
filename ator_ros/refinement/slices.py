"""Work in slices, so that one request neither delays others nor outlasts its deadline.

The core reads no clock: who drives the work sends in whether its time is up.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import TypeVar

Result = TypeVar("Result")

Slices = Generator[None, bool, Result]
"""Work that yields before each slice, is sent whether time is up, and returns its result.

A slice takes about a millisecond with the shipped models, and up to five with those that know more kinds of
motion. When time is up, the work returns the best result so far, after a few short slices more.
"""


def completed(work: Slices[Result]) -> Result:
    """Do all of `work` at once, without a deadline, and return its result."""
    try:
        next(work)
        while True:
            work.send(False)
    except StopIteration as end:
        result: Result = end.value
        return result
