"""The files that ship with the package: config/, models/, urdf/, launch/, rviz/."""

from __future__ import annotations

from functools import cache
from pathlib import Path

PACKAGE = "ator_ros"


class ResourceError(FileNotFoundError):
    """A shipped file or folder is missing."""


@cache
def share_folder() -> Path:
    """Return the folder of the shipped files; raises ResourceError if the package is not installed.

    In a checkout, also one built with ``colcon build --symlink-install``, it is the checkout, so
    that edits take effect at once. Otherwise it is the installed ``share/ator_ros``.
    """
    checkout = Path(__file__).resolve().parents[1]
    if (checkout / "package.xml").is_file() and (checkout / "config").is_dir():
        return checkout
    try:
        from ament_index_python.packages import get_package_share_directory

        return Path(get_package_share_directory(PACKAGE))
    except (ImportError, LookupError) as error:
        raise ResourceError(
            f"expected {PACKAGE}'s files in {checkout} or in a sourced ROS 2 workspace, got {error}"
        ) from error


def resource_path(*parts: str) -> Path:
    """Return the path of a shipped file or folder, as in ``resource_path("models", "shoot.json")``.

    Raises ResourceError if it is missing.
    """
    path = share_folder().joinpath(*parts)
    if not path.exists():
        raise ResourceError(f"expected {PACKAGE}'s file {path}, there is none")
    return path
