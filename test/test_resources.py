"""Shipped files are found in a checkout and in an installed share folder, and missed with a clear error."""

from __future__ import annotations

import sys
import types
from collections.abc import Iterator
from pathlib import Path

import pytest

from ator_ros import resources
from ator_ros.resources import ResourceError, resource_path, share_folder


@pytest.fixture(autouse=True)
def _fresh_cache() -> Iterator[None]:
    share_folder.cache_clear()
    yield
    share_folder.cache_clear()


@pytest.fixture
def no_checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Pretend that the module lies in a site-packages folder, as after an ordinary install."""
    module = tmp_path / "lib" / "site-packages" / "ator_ros" / "resources.py"
    monkeypatch.setattr(resources, "__file__", str(module))
    return tmp_path


def _fake_index(monkeypatch: pytest.MonkeyPatch, share: Path | None) -> None:
    """Put an ament index in place that knows `share`, or knows nothing."""

    class PackageNotFoundError(KeyError):
        pass

    def get_package_share_directory(name: str) -> str:
        if share is None:
            raise PackageNotFoundError(name)
        return str(share)

    packages = types.ModuleType("ament_index_python.packages")
    packages.__dict__.update(
        PackageNotFoundError=PackageNotFoundError, get_package_share_directory=get_package_share_directory
    )
    monkeypatch.setitem(sys.modules, "ament_index_python", types.ModuleType("ament_index_python"))
    monkeypatch.setitem(sys.modules, "ament_index_python.packages", packages)


def test_finds_files_in_an_installed_share_folder(no_checkout: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    share = no_checkout / "share" / "ator_ros"
    (share / "config").mkdir(parents=True)
    (share / "config" / "pioneer.yaml").write_text("name: pioneer\n", encoding="utf-8")
    _fake_index(monkeypatch, share)
    assert resource_path("config", "pioneer.yaml") == share / "config" / "pioneer.yaml"


def test_a_missing_file_is_named_with_what_is_there() -> None:
    with pytest.raises(ResourceError, match=r"config/pionier\.yaml.*holds.*pioneer\.yaml"):
        resource_path("config", "pionier.yaml")
