"""Who can reach our nodes: nobody beyond this machine, unless the user wants it."""

from __future__ import annotations

import socket
import struct
from pathlib import Path

import pytest
from conftest import Start
from process import Process
from ros_client import Client

from ator_ros.nodes.network import PROFILES, RANGE, stay_on_this_machine

LOOPBACK = "127.0.0.1"
NODES = {"simulation": "simulating", "executor": "ready for chains", "refinement": "refining chains"}


@pytest.mark.parametrize("node", NODES)
def test_the_ports_of_a_node_take_in_what_this_machine_sends(
    start: Start, client: Client, domain: int, node: str
) -> None:
    process = start(node)
    client.eventually(lambda: NODES[node] in process.output, "the node is ready")
    # Ports of the domain, as the DDS standard has them; what sends has ports from elsewhere.
    ports = range(7400 + 250 * domain, 7400 + 250 * (domain + 1))
    places = {address for address, port in udp_sockets(process) if port in ports}
    assert places == {LOOPBACK}


def udp_sockets(process: Process) -> list[tuple[str, int]]:
    """Give address and port of each UDP socket of a process."""
    folder = Path("/proc", str(process.pid))
    mine = {str(file.readlink()) for file in (folder / "fd").iterdir()}
    lines = [line.split() for line in (folder / "net" / "udp").read_text(encoding="utf-8").splitlines()[1:]]
    places = [words[1].split(":") for words in lines if f"socket:[{words[9]}]" in mine]
    return [(socket.inet_ntoa(struct.pack("=I", int(where, 16))), int(port, 16)) for where, port in places]


def test_what_the_user_has_set_stays() -> None:
    silent: dict[str, str] = {}
    stay_on_this_machine(silent)
    assert silent[RANGE] == "LOCALHOST"
    assert Path(silent[PROFILES]).is_file()
    network = {RANGE: "SUBNET"}
    stay_on_this_machine(network)
    assert network == {RANGE: "SUBNET"}
    own = {PROFILES: "/my/profiles.xml"}
    stay_on_this_machine(own)
    assert own == {PROFILES: "/my/profiles.xml", RANGE: "LOCALHOST"}
