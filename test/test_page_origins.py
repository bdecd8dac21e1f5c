"""Whom a page lets in: itself in the browser and programs, but no other site."""

from __future__ import annotations

import http.client
import socket
import threading
from collections.abc import Iterator

import pytest
from free_port import free_port

pytest.importorskip("viser", reason="needs viser: docs/install.md")

import viser
import websockets.asyncio.server
from viser_client import ViserClient
from websockets.datastructures import Headers
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.page.origins import is_welcome, only_own_page
from ator_ros.page.serving import LOOPBACK, served

ROBOT = SOCCER.robot()


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    server = served(SOCCER, ROBOT, port=free_port())
    yield server.get_port()
    server.stop()


def opened(port: int, host: str = LOOPBACK, **headers: str) -> int:
    """Return the status with which a WebSocket is opened or refused."""
    version = f"viser-v{viser.__version__}"
    try:
        with (
            socket.create_connection((LOOPBACK, port)) as own,
            connect(f"ws://{host}:{port}", sock=own, subprotocols=[version], additional_headers=headers),
        ):
            return 101
    except InvalidStatus as error:
        return error.response.status_code


def test_no_other_site_in_the_browser_can_use_the_page(port: int) -> None:
    others = (
        "http://example.org",
        f"http://example.org:{port}",
        f"http://localhost.example.org:{port}",
        f"http://{LOOPBACK}:{port + 1}",
        f"http://localhost:{port}",  # another name than the one that is asked
        f"ftp://{LOOPBACK}:{port}",
        "null",
        "",
    )
    assert {origin: opened(port, Origin=origin) for origin in others} == dict.fromkeys(others, 403)
    # A name whose owner lets it lead to this machine is both origin and host.
    assert opened(port, "example.org", Origin=f"http://example.org:{port}") == 403


def test_the_page_itself_and_programs_can(port: int) -> None:
    for host in (LOOPBACK, "localhost", "LocalHost"):
        assert opened(port, host, Origin=f"http://{host}:{port}") == 101
    client = ViserClient(port)  # without an origin
    client.until(lambda: "/floor" in client.scene, "the floor")
    client.close()


def test_no_client_can_let_the_page_be_shared_on_the_internet(
    port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = threading.Event()
    for name in ("request_share_url", "disconnect_share_url"):
        monkeypatch.setattr(viser.ViserServer, name, lambda _: asked.set())
    client = ViserClient(port)
    client.until(lambda: "/floor" in client.scene, "the floor")
    client.send("ShareUrlRequest")
    client.send("ShareUrlDisconnect")
    assert not asked.wait(1.0)
    client.close()


def test_its_files_are_served_as_before(port: int) -> None:
    connection = http.client.HTTPConnection(LOOPBACK, port)
    connection.request("GET", "/", headers={"Origin": "http://example.org"})
    assert connection.getresponse().status == 200
    connection.close()


@pytest.mark.parametrize(
    ("host", "place", "welcome"),
    [
        (LOOPBACK, "localhost:9000", True),  # a forwarded port
        ("0.0.0.0", "192.168.1.5:8080", True),  # noqa: S104
        ("0.0.0.0", f"{socket.gethostname()}:8080", True),  # noqa: S104
        ("0.0.0.0", "lab.example.org:8080", False),  # noqa: S104
        ("lab.example.org", "lab.example.org:8080", True),
        ("::1", "[::1]:8080", True),
        ("::1", "[::1:8080", False),
    ],
)
def test_the_page_is_known_by_its_address(host: str, place: str, welcome: bool) -> None:
    assert is_welcome(Headers(Origin=f"http://{place}", Host=place), host) is welcome


def test_two_origins_are_none() -> None:
    place = f"{LOOPBACK}:8080"
    twice = Headers([("Origin", f"http://{place}"), ("Origin", f"http://{place}"), ("Host", place)])
    assert not is_welcome(twice, LOOPBACK)


def test_a_viser_that_cannot_be_guarded_serves_nobody() -> None:
    before = websockets.asyncio.server.serve
    with pytest.raises(RuntimeError, match="lets every site in"), only_own_page(LOOPBACK):
        pass
    assert websockets.asyncio.server.serve is before
