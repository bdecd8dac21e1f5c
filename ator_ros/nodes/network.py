"""Who can reach a node: this machine only, unless the user opens it to a network."""

from __future__ import annotations

from collections.abc import MutableMapping

from ator_ros.resources import resource_path

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
THIS_MACHINE = "LOCALHOST"
PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"


def stay_on_this_machine(environment: MutableMapping[str, str]) -> None:
    """Set the environment variables that keep ROS on this machine, where the user has not set them.

    `RANGE` limits discovery, with any middleware; Fast DDS would still take in messages from everywhere,
    which the file that `PROFILES` names forbids. Call this before ``rclpy.init``.

    Parameters
    ----------
    environment : mutable mapping
        ``os.environ``, or that of a process to be started.
    """
    if environment.setdefault(RANGE, THIS_MACHINE) == THIS_MACHINE:
        environment.setdefault(PROFILES, str(resource_path("config", "fastdds_loopback.xml")))
