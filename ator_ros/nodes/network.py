"""Network access: nodes can be reached from this machine only, unless the user opens them to a network."""

from __future__ import annotations

from collections.abc import MutableMapping

from ator_ros.resources import resource_path

RANGE, THIS_MACHINE = "ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST"
PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
_OPEN = ("SUBNET", "SYSTEM_DEFAULT")
_ONLY_HERE = "ROS_LOCALHOST_ONLY"  # of older distributions; overrides RANGE
_ELSEWHERE = ("ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER")


def stay_on_this_machine(environment: MutableMapping[str, str]) -> None:
    """Set the environment variables that keep ROS on this machine, unless the user has asked for a network.

    A `RANGE` of SUBNET or SYSTEM_DEFAULT, static peers, or a discovery server ask for a network. `RANGE`
    limits
    discovery with any middleware. Fast DDS would still accept messages from everywhere, which the file that
    `PROFILES` names forbids. Call this before ``rclpy.init``.

    Parameters
    ----------
    environment : mutable mapping
        ``os.environ``, or the environment of a process to be started. An empty variable counts as unset.
    """
    environment[RANGE] = environment.get(RANGE) or THIS_MACHINE
    is_open = environment[RANGE] in _OPEN and environment.get(_ONLY_HERE) != "1"
    if not is_open and not any(environment.get(name) for name in (*_ELSEWHERE, PROFILES)):
        environment[PROFILES] = str(resource_path("config", "fastdds_loopback.xml"))
