"""Selection of test cases for the default suite."""

from collections.abc import Iterable
from typing import Any

import pytest


def few(values: Iterable[Any], *kept: Any) -> list[Any]:
    """Return the parameters of a test; those not in `kept` run only in `make test-long`."""
    return [
        pytest.param(value, marks=() if value in kept else pytest.mark.long) for value in values
    ]
