"""Shapes, robots and objects in viser's scene."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping
from types import MappingProxyType

import numpy as np
import viser
import yourdfpy
from viser.extras import ViserUrdf

from ator_ros.geometry import Pose, quaternion_from_yaw
from ator_ros.viewing.shapes import Arrow, Colour, Segments, Shape
from ator_ros.world.scene import Area

NO_ANGLES: Mapping[str, float] = MappingProxyType({})
_ABOVE_FLOOR = 0.04


def wxyz(yaw: float) -> tuple[float, float, float, float]:
    """Return the quaternion of a heading in rad in viser's order."""
    x, y, z, w = quaternion_from_yaw(yaw)
    return w, x, y, z


def rgb(colour: Colour) -> tuple[int, int, int]:
    """Return a colour as viser wants it."""
    red, green, blue = (round(255 * part) for part in colour)
    return red, green, blue


class Canvas:
    """A group of shapes that is redrawn as a whole; unchanged shapes are not sent again.

    Parameters
    ----------
    server : ViserServer
        The page's server.
    group : str
        Path in the scene.
    area : Area
        Its centre is the origin of the page, which draws in single precision.
    height : float
        Above the floor in m.
    """

    def __init__(
        self, server: viser.ViserServer, group: str, area: Area, height: float = _ABOVE_FLOOR
    ) -> None:
        self._scene, self._group, self._height = server.scene, group, height
        self._centre = np.array([area.x, area.y])
        self._shown: dict[str, tuple[bytes, viser.LineSegmentsHandle]] = {}

    def draw(self, shapes: Iterable[Shape]) -> None:
        """Show these shapes, and no others of this group."""
        wanted = {shape.name: shape for shape in shapes}
        for name in set(self._shown) - set(wanted):
            self._shown.pop(name)[1].remove()
        for name, shape in wanted.items():
            points, colours, width = _lines(shape)
            digest = points.tobytes() + colours.tobytes()
            if name in self._shown and self._shown[name][0] == digest:
                continue
            if not len(points):
                if name in self._shown:
                    self._shown.pop(name)[1].remove()
                continue
            self._shown[name] = digest, self._drawn(name, points, colours, width)

    def _drawn(
        self, name: str, points: np.ndarray, colours: np.ndarray, width: float
    ) -> viser.LineSegmentsHandle:
        """Draw a shape; one that is there is changed, which costs a fraction of a new one."""
        heights = np.full((*points.shape[:2], 1), self._height)
        places = np.concatenate([points - self._centre, heights], axis=2).astype(np.float32)
        paint = np.repeat((255 * colours).astype(np.uint8)[:, None, :], 2, axis=1)
        if name not in self._shown:
            return self._scene.add_line_segments(f"{self._group}/{name}", places, paint, thickness=width)
        handle = self._shown[name][1]
        handle.points, handle.colors, handle.thickness = places, paint, width
        return handle


def _lines(shape: Shape) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the segments (n, 2, 2), their colours (n, 3), and their width in m."""
    if isinstance(shape, Segments):
        return shape.points, shape.colours, shape.width
    return _arrow(shape)


def _arrow(arrow: Arrow) -> tuple[np.ndarray, np.ndarray, float]:
    tip = arrow.pose.ahead(arrow.length)
    barbs = [tip._replace(yaw=tip.yaw + turn).ahead(-0.4 * arrow.length) for turn in (0.45, -0.45)]
    ends = [(arrow.pose, tip), *((tip, barb) for barb in barbs)]
    points = np.array([[(a.x, a.y), (b.x, b.y)] for a, b in ends])
    return points, np.tile(np.asarray(arrow.colour, dtype=float), (len(points), 1)), 0.04


class RobotModel:
    """A robot in the scene, from its URDF.

    Parameters
    ----------
    server : ViserServer
        The page's server.
    name : str
        Path in the scene.
    urdf : str
        The robot's description.
    area : Area
        Its centre is the origin of the page.
    ghost : bool
        Whether it is drawn pale.
    """

    def __init__(
        self, server: viser.ViserServer, name: str, urdf: str, area: Area, *, ghost: bool = False
    ) -> None:
        self._area = area
        self._frame = server.scene.add_frame(name, show_axes=False, visible=not ghost)
        colour = (0.62, 0.64, 0.68, 0.35) if ghost else None
        model = yourdfpy.URDF.load(io.BytesIO(urdf.encode()))
        self._urdf = ViserUrdf(server, model, root_node_name=name, mesh_color_override=colour)
        self._joints = self._urdf.get_actuated_joint_names()
        self._angles: tuple[float, ...] = ()

    def show(self, pose: Pose | None, angles: Mapping[str, float] = NO_ANGLES) -> None:
        """Show it at a pose, its joints at `angles` (rad, by name); None hides it."""
        if self._frame.visible != (pose is not None):
            self._frame.visible = pose is not None
        if pose is None:
            return
        position, turn = (pose.x - self._area.x, pose.y - self._area.y, 0.0), wxyz(pose.yaw)
        if tuple(self._frame.position) != position:
            self._frame.position = position
        if tuple(self._frame.wxyz) != turn:
            self._frame.wxyz = turn
        turned = tuple(angles.get(name, 0.0) for name in self._joints)
        if turned != self._angles:
            self._angles = turned
            self._urdf.update_cfg(np.asarray(turned))


def write(text: viser.GuiMarkdownHandle, content: str) -> None:
    """Let a text of the panel say something; it is sent only if it is new."""
    if text.content != content:
        text.content = content
