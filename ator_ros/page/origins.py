"""Who may open a page's WebSocket: the page itself, and programs; no other site that a browser shows.

A browser lets any site connect to an address of this machine, and tells in the header Origin which it is.
"""

from __future__ import annotations

import contextlib
import http
import ipaddress
import socket
from collections.abc import Callable, Iterator
from typing import Any
from urllib.parse import urlsplit

import websockets.asyncio.server
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

_LOOPBACK = "localhost"
_SCHEMES = ("http", "https")


def is_welcome(headers: Headers, host: str) -> bool:
    """Return whether a request comes from the page that is served at `host`, or from no site at all.

    A site is the page if it has the address that is asked, and that address is a number, a name of this
    machine, or `host`: any other name may lead here by a trick of its owner's.
    """
    origins, asked = headers.get_all("Origin"), headers.get_all("Host")
    if not origins:
        return True
    if len(origins) > 1 or len(asked) != 1:
        return False
    scheme, _, place = origins[0].lower().partition("://")
    return scheme in _SCHEMES and place == asked[0].lower() and _is_ours(place, host.lower())


def _is_ours(place: str, host: str) -> bool:
    try:
        name = urlsplit(f"//{place}").hostname or ""
    except ValueError:
        return False
    if name in (_LOOPBACK, host, socket.gethostname().lower()) or name.endswith(f".{_LOOPBACK}"):
        return True
    with contextlib.suppress(ValueError):
        ipaddress.ip_address(name)
        return True
    return False


@contextlib.contextmanager
def only_own_page(host: str) -> Iterator[None]:
    """Let the server of viser that is made meanwhile refuse other sites: viser passes no such option on.

    Raises
    ------
    RuntimeError
        No server was made, or viser makes it otherwise: it would let everybody in.
    """
    serve, made = websockets.asyncio.server.serve, []

    def guarded(*words: Any, process_request: Callable[..., Any] | None = None, **options: Any) -> Any:
        def process(connection: Any, request: Request) -> Response | Any:
            if "Upgrade" in request.headers and not is_welcome(request.headers, host):
                return connection.respond(http.HTTPStatus.FORBIDDEN, "this site may not use the page\n")
            return None if process_request is None else process_request(connection, request)

        made.append(words)
        return serve(*words, process_request=process, **options)

    websockets.asyncio.server.serve = guarded  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve  # type: ignore[misc]
    if not made:
        raise RuntimeError(
            "viser serves in a way that lets every site in: expected its version in requirements/"
        )
