"""A missing shipped file is reported with the available ones."""

from __future__ import annotations

import pytest

from ator_ros.resources import ResourceError, resource_path


def test_a_missing_file_is_reported_with_the_available_ones() -> None:
    with pytest.raises(ResourceError, match=r"config/pionier\.yaml.*holds.*pioneer\.yaml"):
        resource_path("config", "pionier.yaml")
