"""Print whether a package is installed: what the launch file asks before it starts a program of others."""

from __future__ import annotations

import sys

from ament_index_python.packages import PackageNotFoundError, get_package_prefix


def is_installed(package: str) -> bool:
    """Return whether a package is in a prefix that is sourced."""
    try:
        get_package_prefix(package)
    except (PackageNotFoundError, OSError):  # no prefix is known without ROS
        return False
    return True


if __name__ == "__main__":
    sys.stdout.write(str(is_installed(sys.argv[1])).lower())
