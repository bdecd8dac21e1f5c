"""Access to nodes: only from this machine, unless the user opens them to a network."""

from __future__ import annotations

import os
import random
from collections.abc import Iterator, MutableMapping
from contextlib import contextmanager
from pathlib import Path

from ator_ros.printable import ReadableError
from ator_ros.resources import resource_path

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
THIS_MACHINE = "LOCALHOST"
PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
_OPEN = ("SUBNET", "SYSTEM_DEFAULT")
_ELSEWHERE = ("ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER")
_DOMAINS = 100  # greatest ROS domain whose ports are outside the ephemeral ones of Linux
# UDP ports in the DDS standard: the first one of domain 0, and the number of ports of a domain
_FIRST_PORT = 7400
_PORTS = 250


class NodesError(ReadableError, RuntimeError):
    """Required nodes do not run, or a request to them failed."""


class UnavailableError(NodesError):
    """A required node is not running, but may start later."""


def stay_on_this_machine(environment: MutableMapping[str, str]) -> None:
    """Set the environment variables that keep ROS on this machine, before ``rclpy.init``.

    Nothing changes if the user asks for a network by a `RANGE` of SUBNET or SYSTEM_DEFAULT, static
    peers, or a discovery server. `RANGE` limits discovery with any middleware. Fast DDS would still
    accept messages from other machines, which the file that `PROFILES` names forbids. An empty
    variable counts as unset.
    """
    environment[RANGE] = environment.get(RANGE) or THIS_MACHINE
    if environment[RANGE] not in _OPEN and not any(
        environment.get(name) for name in (*_ELSEWHERE, PROFILES)
    ):
        environment[PROFILES] = str(resource_path("config", "fastdds_loopback.xml"))


@contextmanager
def free_domain() -> Iterator[int]:
    """Reserve a ROS domain (1 to 100), not the caller's, without nodes on this machine.

    Raises RuntimeError if all domains are reserved or have nodes.
    """
    import domain_coordinator

    used = {*domains_in_use(), int(os.environ.get("ROS_DOMAIN_ID") or 0)}
    free = [domain for domain in range(1, _DOMAINS + 1) if domain not in used]
    if not free:
        raise RuntimeError(
            "ROS domain: expected one from 1 to 100 without nodes, got nodes in all; end some"
        )
    reserved = domain_coordinator.domain_id(lambda: random.choice(free))
    domain = reserved.__enter__()
    try:
        yield domain
    finally:
        # in a `with` it would handle an OSError of the caller as its own
        reserved.__exit__(None, None, None)


def domains_in_use() -> set[int]:
    """Return the ROS domains whose UDP ports are open on this machine, of any user."""
    rows = [row.split() for row in Path("/proc/net/udp").read_text().splitlines()[1:]]
    ports = [int(row[1].rpartition(":")[2], 16) for row in rows]
    return {(port - _FIRST_PORT) // _PORTS for port in ports if port >= _FIRST_PORT}
