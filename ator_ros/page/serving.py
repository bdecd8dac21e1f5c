"""A page with an empty scene: floor, lines, bays, and the camera of a new client."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import io
import logging
import math
import socket
import traceback
from pathlib import Path

import viser

from ator_ros.domains.domain import Domain
from ator_ros.page.drawing import Canvas
from ator_ros.page.origins import only_own_page
from ator_ros.printable import printable
from ator_ros.robot.description import Robot
from ator_ros.viewing.surroundings import surroundings

LOOPBACK = "127.0.0.1"
_CAMERA_HEIGHT = 0.85
"""Height of the camera as a share of the area's length."""
_FLOOR = (72, 122, 84)
_LAST_PORT = 65535
_PACKAGE = Path(__file__).parents[1]


class _OneLine(logging.Filter):
    """Tells what a client sent that viser could not read in one line; errors of ours keep their traceback."""

    def filter(self, record: logging.LogRecord) -> bool:
        """Change a record with an error of viser's; keep all."""
        error = record.exc_info[1] if record.exc_info else None
        if error is not None and not _passed_through_ours(error):
            record.msg = f"view: ignored what a client sent: {printable(repr(error), 200)}"
            record.args, record.exc_info = (), None
        return True


def _passed_through_ours(error: BaseException) -> bool:
    frames = (frame for frame, _ in traceback.walk_tb(error.__traceback__))
    return any(Path(frame.f_code.co_filename).is_relative_to(_PACKAGE) for frame in frames)


_ONE_LINE = _OneLine()


class _LoopsEvent(asyncio.Event):
    """Is set by its loop alone: viser sets it from our thread, too, which may raise as clients come and go.

    The view would then end. From the loop viser sets it again.
    """

    def set(self) -> None:
        """Wake up who waits, where that is safe."""
        with contextlib.suppress(RuntimeError):
            asyncio.get_running_loop()
            super().set()


def camera_over(robot: Robot) -> tuple[tuple[float, float, float], tuple[float, float, float], float]:
    """Return where a new client's camera is and looks at (m), and its vertical field of view (rad).

    The origin of the page is the centre of the area.
    """
    area = robot.scene.area
    look_at = (0.0, -0.05 * area.width, 0.0)
    return (0.0, -0.75 * area.width, _CAMERA_HEIGHT * area.length), look_at, math.radians(50.0)


def free_port(host: str, port: int) -> int:
    """Return the first port from `port` on that is free at an address; viser waits for ever without one.

    Raises
    ------
    OSError
        The address is none of this machine, or no such port is free.
    """
    for number in range(port, _LAST_PORT + 1):
        try:
            family, _, _, _, place = socket.getaddrinfo(host, number, type=socket.SOCK_STREAM)[0]
            with socket.create_server(place, family=family):
                return number
        except (OSError, ValueError) as error:  # no name at all is a ValueError
            if not isinstance(error, OSError) or error.errno != errno.EADDRINUSE:
                raise OSError(f"expected an address of this machine, got {host!r}: {error}") from error
    raise OSError(f"expected a free port from {port} on at {host}, got none")


def _never_shared(server: viser.ViserServer) -> None:
    """Take away what lets any client have the page forwarded from the internet, by a server of viser's."""
    for wish in (viser._messages.ShareUrlRequest, viser._messages.ShareUrlDisconnect):
        server._websock_server.unregister_handler(wish)


def served(domain: Domain, robot: Robot, *, host: str = LOOPBACK, port: int = 8080) -> viser.ViserServer:
    """Serve a page on one port, or the next that is free; by default only this machine can reach it.

    Raises
    ------
    OSError
        It cannot be served there.
    """
    port = free_port(host, port)
    logging.getLogger("websockets").setLevel(logging.CRITICAL)  # a browser that goes away is no error
    logging.getLogger("asyncio").addFilter(_ONE_LINE)  # ignored where it is there already
    with contextlib.redirect_stdout(io.StringIO()), only_own_page(host):  # viser tells its address in a frame
        server = viser.ViserServer(host=host, port=port, label="ator_ros", verbose=False)
    _never_shared(server)
    server._websock_server.get_message_buffer().message_event.__class__ = _LoopsEvent
    area, (position, look_at, fov) = robot.scene.area, camera_over(robot)
    server.scene.set_up_direction("+z")
    server.gui.configure_theme(show_logo=False, show_share_button=False)
    server.gui.main_panel.dock_right()
    camera = server.initial_camera
    camera.position, camera.look_at, camera.fov = position, look_at, fov
    size = (area.length + 2.0 * area.margin, area.width + 2.0 * area.margin, 0.02)
    server.scene.add_box(
        "/floor", color=_FLOOR, dimensions=size, position=(0.0, 0.0, -0.01), cast_shadow=False
    )
    Canvas(server, "/surroundings", area, 0.02).draw(surroundings(domain, robot))
    return server
