"""Nodes communicate only on this machine, unless the user configures otherwise."""

import contextlib
import socket
import struct
from pathlib import Path

import pytest
from conftest import Start
from process import Process
from ros_client import Client
from selection import few

from ator_ros.nodes.network import (
    PROFILES,
    RANGE,
    THIS_MACHINE,
    domains_in_use,
    free_domain,
    stay_on_this_machine,
)

LOOPBACK = "127.0.0.1"
NODES = {
    "simulation": "simulating",
    "executor": "ready for chains",
    "refinement": "refining chains",
}


@pytest.mark.parametrize("node", few(NODES, "simulation"))
def test_a_node_listens_to_this_machine_only_and_ends_cleanly(
    start: Start, client: Client, domain: int, node: str
) -> None:
    process = start(node)
    client.eventually(lambda: NODES[node] in process.output, "the node is ready")
    assert listens_at(process, domain) == {LOOPBACK}
    assert process.stop() == 0
    assert "Traceback" not in process.output


def listens_at(process: Process, domain: int) -> set[str]:
    """Return the addresses of its receiving sockets.

    Sending sockets have ports chosen by the kernel.
    """
    low, high = map(int, Path("/proc/sys/net/ipv4/ip_local_port_range").read_text().split())
    of_domain = range(7400 + 250 * domain, 7400 + 250 * (domain + 1))
    return {
        address
        for address, port in udp_sockets(process)
        if port in of_domain or not low <= port <= high
    }


def udp_sockets(process: Process) -> list[tuple[str, int]]:
    """Return address and port of each UDP socket of a process."""
    folder = Path("/proc", str(process.pid))
    mine = set()
    for file in (folder / "fd").iterdir():
        with contextlib.suppress(FileNotFoundError):
            mine.add(str(file.readlink()))
    places = []
    for table, family, words in (("udp", socket.AF_INET, 1), ("udp6", socket.AF_INET6, 4)):
        for line in (folder / "net" / table).read_text(encoding="utf-8").splitlines()[1:]:
            _, local, *rest = line.split()
            if f"socket:[{rest[7]}]" in mine:
                number, _, port = local.partition(":")
                packed = b"".join(
                    struct.pack("=I", int(number[8 * i : 8 * i + 8], 16)) for i in range(words)
                )
                places.append((socket.inet_ntop(family, packed), int(port, 16)))
    return places


@pytest.mark.parametrize(
    "configured",
    [
        {RANGE: "SUBNET"},
        {RANGE: "SYSTEM_DEFAULT"},
        {RANGE: "LOCALHOST", "ROS_STATIC_PEERS": "10.0.0.2"},
        {RANGE: "LOCALHOST", "ROS_DISCOVERY_SERVER": "10.0.0.2:11811"},
        {RANGE: "LOCALHOST", PROFILES: "/my/profiles.xml"},
    ],
)
def test_user_settings_are_kept(configured: dict[str, str]) -> None:
    environment = dict(configured)
    stay_on_this_machine(environment)
    assert environment == configured


@pytest.mark.parametrize("settings", [{}, {RANGE: ""}, {RANGE: "OFF"}, {RANGE: "nonsense"}])
def test_other_settings_restrict_discovery_to_this_machine(settings: dict[str, str]) -> None:
    environment = dict(settings)
    stay_on_this_machine(environment)
    assert environment[RANGE] == (settings.get(RANGE) or THIS_MACHINE)
    assert Path(environment[PROFILES]).is_file()


def test_a_free_domain_is_unused_and_differs_from_the_callers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with free_domain() as own, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        node = own % 100 + 1
        other.bind(("127.0.0.1", 7400 + 250 * node + 200))  # one of its ports
        assert node in domains_in_use()
        monkeypatch.setenv("ROS_DOMAIN_ID", str(node % 100 + 1))
        with free_domain() as domain:
            assert domain not in (own, node, node % 100 + 1)
