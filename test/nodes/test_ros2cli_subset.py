"""The subset of `ros2` gives parameters the types that a launch file names."""

from __future__ import annotations

from typing import Any

import pytest
import yaml
from ros2cli_subset import typed


@pytest.mark.parametrize(
    ("value", "kind", "expected"),
    [("5", "float", 5.0), ("5", None, 5), ("5", "str", "5"), ("", None, ""), ("true", "bool", True)],
)
def test_a_parameter_has_the_type_that_is_named(value: str, kind: str | None, expected: Any) -> None:
    read = yaml.safe_load(typed(value, kind))
    assert (read, type(read)) == (expected, type(expected))
