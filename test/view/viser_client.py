"""A client of a page without a browser: it receives messages and stores nodes' positions."""

import contextlib
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

import msgspec
import viser
import zstandard
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

_HEADER = 16
_PATIENCE = 20.0
_HEIGHT = 1000.0
"""Distance of the camera in m: so far that picking does not depend on the height of objects."""


def free_port() -> int:
    """Return a TCP port that is not in use."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


class ViserClient:
    """Connects immediately; `scene` has the position of each node by name, None at first.

    `drawn` counts how often each node or its lines were received.
    """

    def __init__(self, port: int) -> None:
        self.scene: dict[str, Any] = {}
        self.patience = _PATIENCE
        self.drawn = Counter[str]()
        self._texts: dict[str, str] = {}
        self._fields: dict[str, str] = {}
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
            for node in [
                node for node in self.scene if node == name or node.startswith(f"{name}/")
            ]:
                del self.scene[node]
        elif kind == "SetPositionMessage":
            self.scene[str(name)] = tuple(message["position"])
        elif kind == "SceneNodeUpdateMessage" and "points" in message["updates"]:
            self.drawn[str(name)] += 1
        elif kind == "GuiUpdateMessage":
            self._write(message["uuid"], message["updates"])
        elif "container_uuid" in message and "props" in message:
            self._write(message["uuid"], message["props"])
            self._fields[message["props"].get("label", "")] = message["uuid"]
        elif name is not None and "props" in message:  # updates of existing nodes
            self.scene.setdefault(str(name), None)
            self.drawn[str(name)] += 1

    def _write(self, field: str, properties: dict[str, Any]) -> None:
        if "_markdown" in properties:
            self._texts[field] = properties["_markdown"]

    def text(self) -> str:
        return "\n".join(tuple(self._texts.values()))

    # Messages of a browser

    def send(self, kind: str, **fields: Any) -> None:
        self._socket.send(msgspec.msgpack.encode({"type": kind, **fields}))

    def look(self, place: tuple[Any, ...] = (0.0, -1e-3, _HEIGHT)) -> None:
        """Send the camera's place, without which the server ignores other messages."""
        size = {"image_height": 800, "image_width": 1200, "fov": 0.9, "near": 0.01, "far": 1000.0}
        turn = (1.0, 0.0, 0.0, 0.0)
        up = (0.0, 1.0, 0.0)
        self.send(
            "ViewerCameraMessage",
            wxyz=turn,
            position=place,
            look_at=(0.0, 0.0, 0.0),
            up_direction=up,
            **size,
        )

    def drag(self, node: str, x: float, y: float, phase: str = "update") -> None:
        """Point at (x, y) m on the floor while a node is dragged.

        The phase is start, update or end.
        """
        place, pixel = (x, y, 0.0), (0.5, 0.5)
        self.send(
            "SceneNodeDragMessage", phase=phase, name=node, instance_index=None,
            start_position=place,
            start_screen_pos=pixel, end_position=place, end_screen_pos=pixel, button="left",
            modifier=None,
            owner="",
        )  # fmt: skip

    @property
    def labels(self) -> list[str]:
        return list(self._fields)

    def change(self, label: str, /, **updates: Any) -> None:
        """Change properties of a field, such as its value."""
        self.send("GuiUpdateMessage", uuid=self._fields[label], updates=updates)

    def press(self, label: str) -> None:
        self.look()
        self.change(label, value=True)

    def until(self, happened: Callable[[], Any], what: str) -> None:
        end = time.monotonic() + self.patience
        while not happened():
            assert time.monotonic() < end, f"expected {what} within {self.patience:g} s"
            time.sleep(0.02)

    def vanish(self) -> None:
        """Stop receiving without closing the connection, like a suspended laptop."""
        self._socket.socket.shutdown(socket.SHUT_RDWR)
        self._socket.socket.close()

    def close(self) -> None:
        self._socket.close()
