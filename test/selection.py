"""Which of the many cases of a test run in the ordinary suite."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def few(values: Iterable[Any], *kept: Any) -> list[Any]:
    """Return the parameters of a test, of which those that are not `kept` run in `make test-long` only."""
    return [pytest.param(value, marks=() if value in kept else pytest.mark.long) for value in values]
