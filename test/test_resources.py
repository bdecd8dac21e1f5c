"""A shipped file that is missing is named, with what is there."""

from __future__ import annotations

import pytest

from ator_ros.resources import ResourceError, resource_path


def test_a_missing_file_is_named_with_what_is_there() -> None:
    with pytest.raises(ResourceError, match=r"config/pionier\.yaml.*holds.*pioneer\.yaml"):
        resource_path("config", "pionier.yaml")
