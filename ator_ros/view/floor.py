"""The floor of the page: the server, shapes, robots, and handles to drag."""

from __future__ import annotations

import contextlib
import io
import logging
import math
import socket
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import viser
import yourdfpy
from viser.extras import ViserUrdf

from ator_ros.bases.description import Robot
from ator_ros.domains.domain import Domain
from ator_ros.geometry import Pose, quaternion_from_yaw
from ator_ros.nodes.segments import Color, Label, Segments, surroundings, walls
from ator_ros.refinement.objective import LEAST_WEIGHT
from ator_ros.world.scene import Area

LOOPBACK = "127.0.0.1"
_ABOVE_FLOOR = 0.04  # m
_KNOB_RADIUS = 0.09  # m
_KNOB_DISTANCE = 0.35  # m from the disc that it turns
_FARTHEST = 1000.0  # m from the center; beyond, single precision shows steps of more than 0.1 mm
_PHASES = ("start", "update", "end")


class _Server(viser.ViserServer):
    """A server that ignores invalid messages, and whose clients cannot forward it to the internet.

    viser would store any value that a client sends, and send it to all later clients.
    """

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        # viser has no public place to check messages; requirements/view.txt pins its version
        self._check(self._websock_server)
        self._websock_server.on_client_connect(self._check)

    def _check(self, interface: Any) -> None:
        """Have an interface, of all clients or of one, handle valid messages only."""
        handle = interface._handle_incoming_message

        async def checked(client_id: Any, message: Any) -> None:
            if self._is_valid(message):
                await handle(client_id, message)

        interface._handle_incoming_message = checked

    def _is_valid(self, message: Any) -> bool:
        """Return whether a message is a valid change of a field, drag, or pose of the camera."""
        kind = type(message).__name__
        if kind == "GuiUpdateMessage":
            if not isinstance(message.updates, dict) or list(message.updates) != ["value"]:
                return False
            field = self.gui._gui_input_handle_from_uuid.get(str(message.uuid))
            return _is_valid_value(field, message.updates["value"])
        if kind == "SceneNodeDragMessage":
            is_known = isinstance(message.name, str) and message.phase in _PHASES
            return is_known and _is_near(message.end_position)
        return kind == "ViewerCameraMessage" and _is_near(message.position)

    def request_share_url(self, verbose: bool = True) -> str | None:  # noqa: ARG002
        """Return None."""
        return None


def _is_valid_value(field: Any, value: Any) -> bool:
    """Return whether a client may set a field of the panel to a value."""
    if isinstance(field, viser.GuiNumberHandle):
        if not _is_number(value) or not field.min <= value <= field.max:
            return False
        if 0.0 < abs(value) < LEAST_WEIGHT:  # an objective would refuse it
            return False
        return isinstance(field.value, float) or float(value).is_integer()
    if isinstance(field, viser.GuiDropdownHandle):
        return isinstance(value, str) and value in field.options
    if isinstance(field, viser.GuiCheckboxHandle | viser.GuiButtonHandle):
        return isinstance(value, bool)
    return False


def _is_number(value: Any) -> bool:
    """Return whether a value is a finite number that floats can represent."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return -math.inf < value < math.inf


def _is_near(position: Any) -> bool:
    """Return whether a value is a position in m near the center of the page."""
    if not isinstance(position, list | tuple) or len(position) != 3:
        return False
    return all(_is_number(each) and abs(each) <= _FARTHEST for each in position)


def serve(
    domain: Domain,
    robot: Robot,
    *,
    host: str = LOOPBACK,
    port: int = 8080,
) -> viser.ViserServer:
    """Serve a page with floor, lines and bays on `port` or the next free port.

    Raises OSError if the host is no address of this machine.
    """
    try:
        found = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)
        family, _, _, _, address = found[0]
        socket.create_server(address, family=family).close()  # viser would wait forever
    except (OSError, ValueError) as error:
        raise OSError(f"expected an address of this machine, got {host!r}: {error}") from error
    logging.getLogger("websockets").setLevel(logging.CRITICAL)  # it logs disconnects as errors
    with contextlib.redirect_stdout(io.StringIO()):  # viser prints a banner
        server = _Server(host=host, port=port, label="ator_ros", verbose=False)
    area = robot.scene.area
    server.scene.set_up_direction("+z")
    server.gui.configure_theme(show_logo=False, show_share_button=False)
    server.gui.main_panel.dock_right()
    camera = server.initial_camera
    camera.position = (0.0, -0.75 * area.width, 0.85 * area.length)
    camera.look_at = (0.0, -0.05 * area.width, 0.0)
    camera.fov = math.radians(50.0)
    length = area.length + 2.0 * area.margin
    width = area.width + 2.0 * area.margin
    server.scene.add_box(
        "/floor",
        color=(72, 122, 84),
        dimensions=(length, width, 0.02),
        position=(0.0, 0.0, -0.01),
        cast_shadow=False,
    )
    shapes = [*surroundings(domain, robot), walls(robot)]
    Canvas(server, "/surroundings", area, 0.02).draw(shapes)
    return server


class Canvas:
    """A group of shapes at a height (m), redrawn as a whole.

    The center of `area` is the origin of the page: browsers draw in single precision.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        group: str,
        area: Area,
        height: float = _ABOVE_FLOOR,
    ) -> None:
        self._scene = server.scene
        self._group = group
        self._height = height
        self._center = np.array([area.x, area.y])
        self._shown: dict[str, viser.LineSegmentsHandle] = {}
        self._labels: list[viser.LabelHandle] = []

    def label(self, labels: Iterable[Label]) -> None:
        """Replace all texts of this group."""
        while self._labels:
            self._labels.pop().remove()
        for label in labels:
            x, y = np.array([label.x, label.y]) - self._center
            node = f"{self._group}/{label.name}"
            position = (float(x), float(y), self._height)
            self._labels.append(self._scene.add_label(node, label.text, position=position))

    def draw(self, shapes: Iterable[Segments]) -> None:
        """Replace all shapes of this group."""
        drawn = {shape.name: shape for shape in shapes if len(shape.points)}
        for name in set(self._shown) - set(drawn):
            self._shown.pop(name).remove()
        for name, shape in drawn.items():
            points = np.insert(shape.points - self._center, 2, self._height, axis=2)
            points = points.astype(np.float32)
            colors = (255 * shape.colors).astype(np.uint8)
            colors = np.repeat(colors[:, None, :], 2, axis=1)  # of both ends
            if name in self._shown:  # changing a shape is much cheaper than a new one
                handle = self._shown[name]
                handle.points = points
                handle.colors = colors
                handle.thickness = shape.width
            else:
                node = f"{self._group}/{name}"
                self._shown[name] = self._scene.add_line_segments(
                    node, points, colors, thickness=shape.width
                )


class Movable:
    """An item of the scene with a pose; the center of `area` is the origin of the page."""

    def __init__(self, server: viser.ViserServer, name: str, area: Area) -> None:
        self._area = area
        self._pose = Pose(math.inf, math.inf, 0.0)
        self._frame = server.scene.add_frame(name, show_axes=False)

    def show(self, pose: Pose | None) -> None:
        """Show the item at a pose, or hide it if that is None."""
        self._frame.visible = pose is not None
        if pose is not None:
            self._pose = pose
            east = pose.x - self._area.x
            north = pose.y - self._area.y
            self._frame.position = (east, north, 0.0)
            x, y, z, w = quaternion_from_yaw(pose.yaw)
            self._frame.wxyz = (w, x, y, z)


class RobotModel(Movable):
    """A robot, drawn from its URDF."""

    def __init__(self, server: viser.ViserServer, name: str, urdf: str, area: Area) -> None:
        super().__init__(server, name, area)
        model = yourdfpy.URDF.load(io.BytesIO(urdf.encode()))
        ViserUrdf(server, model, root_node_name=name)


class Handle(Movable):
    """A disc to drag on the floor, with a knob to turn it, or a sphere without a heading.

    Sizes are in m. `moved` is called with the new pose.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        name: str,
        area: Area,
        *,
        radius: float,
        height: float,
        color: Color,
        moved: Callable[[Pose], None],
        sphere: bool = False,
    ) -> None:
        super().__init__(server, name, area)
        self._moved = moved
        self._height = height
        self._offset = (0.0, 0.0)
        scene = server.scene
        center = (0.0, 0.0, height / 2.0)
        body = f"{name}/body"
        if sphere:
            scene.add_icosphere(body, radius, color, position=center).on_drag("left")(self._drag)
            return
        disc = scene.add_cylinder(body, radius, height, color, opacity=0.35, position=center)
        disc.on_drag("left")(self._drag)
        position = (radius + _KNOB_DISTANCE, 0.0, _KNOB_RADIUS)
        knob = scene.add_icosphere(f"{name}/knob", _KNOB_RADIUS, color, position=position)
        knob.on_drag("left")(self._turn)

    async def _drag(self, event: Any) -> None:  # viser runs coroutines in the order of the events
        point = self._pointed(event, self._height)
        if point is None:
            return
        x, y = point
        if event.phase == "start":
            self._offset = (self._pose.x - x, self._pose.y - y)
        dx, dy = self._offset
        self._moved(self._pose._replace(x=x + dx, y=y + dy))

    async def _turn(self, event: Any) -> None:
        point = self._pointed(event, _KNOB_RADIUS)
        if point is None or point == (self._pose.x, self._pose.y):
            return
        x, y = point
        yaw = math.atan2(y - self._pose.y, x - self._pose.x)
        self._moved(self._pose._replace(yaw=yaw))

    def _pointed(self, event: Any, height: float) -> tuple[float, float] | None:
        """Return the intersection of the ray through the pointer with the plane at `height` m.

        None where there is none near the center.
        """
        camera = np.asarray(event.client.camera.position, dtype=float)
        ray = np.asarray(event.end_position, dtype=float) - camera
        if ray[2] == 0.0:
            return None
        share = (height - camera[2]) / ray[2]
        point = (camera + share * ray).tolist()
        if share <= 0.0 or not _is_near(point):
            return None
        return self._area.at(*point[:2])[:2]
