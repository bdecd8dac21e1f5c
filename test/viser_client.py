"""A client of a page without a browser: it receives what viser sends and keeps the places of the nodes."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Callable
from typing import Any

import msgspec
import viser
import zstandard
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

_HEADER = 16
_PATIENCE = 20.0


class ViserClient:
    """Connected at once; `scene` is what it would draw.

    Attributes
    ----------
    scene : dict
        Position of each node that is there, by name; None until one is sent.
    """

    def __init__(self, port: int) -> None:
        self.scene: dict[str, Any] = {}
        version = f"viser-v{viser.__version__}"
        self._socket = connect(f"ws://127.0.0.1:{port}", subprotocols=[version], max_size=None)  # type: ignore[list-item]
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        with contextlib.suppress(ConnectionClosed, OSError):
            for raw in self._socket:
                assert isinstance(raw, bytes)
                size = int.from_bytes(raw[8:_HEADER], "little")
                content = zstandard.ZstdDecompressor().decompress(raw[_HEADER : _HEADER + size])
                for message in msgspec.msgpack.decode(content)["messages"]:
                    self._take(message)

    def _take(self, message: dict[str, Any]) -> None:
        kind, name = message["type"], message.get("name")
        if kind == "RemoveSceneNodeMessage":
            for node in [node for node in self.scene if node == name or node.startswith(f"{name}/")]:
                del self.scene[node]
        elif kind == "SetPositionMessage":
            self.scene[str(name)] = tuple(message["position"])
        elif name is not None:
            self.scene.setdefault(str(name), None)

    def until(self, happened: Callable[[], Any], what: str) -> None:
        """Wait until something has happened."""
        end = time.monotonic() + _PATIENCE
        while not happened():
            assert time.monotonic() < end, f"expected {what} within {_PATIENCE:g} s"
            time.sleep(0.02)

    def vanish(self) -> None:
        """Disappear without a word, as a laptop that is closed."""
        self._socket.socket.shutdown(socket.SHUT_RDWR)
        self._socket.socket.close()

    def close(self) -> None:
        """Go, as a browser's tab does."""
        self._socket.close()
