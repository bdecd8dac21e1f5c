"""What can be dragged on the floor: discs that move a thing, and knobs that turn it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import viser

from ator_ros.geometry import FloatArray, Pose
from ator_ros.page.drawing import rgb, wxyz
from ator_ros.viewing.shapes import Colour
from ator_ros.world.scene import Area

_KNOB = 0.09
_TURNING = 0.35
_OPACITY = 0.35


def on_floor(camera: FloatArray, pointer: FloatArray, height: float) -> tuple[float, float] | None:
    """Return where the ray from `camera` through `pointer`, both (3,) in m, meets the plane at `height`.

    None where it does not meet it in front of the camera.
    """
    ray = pointer - camera
    if abs(ray[2]) < 1e-9:
        return None
    share = (height - camera[2]) / ray[2]
    if share <= 0.0:
        return None
    with np.errstate(over="ignore", invalid="ignore"):
        x, y = map(float, (camera + share * ray)[:2])
    return (x, y) if math.isfinite(x) and math.isfinite(y) else None  # a client may send anything


class Grip:
    """Something that is moved by dragging it, and turned by a knob where it has a heading.

    Parameters
    ----------
    server : ViserServer
        The page's server.
    name : str
        Path in the scene.
    area : Area
        Its centre is the origin of the page.
    radius, height : float
        Of the disc that can be dragged, in m.
    colour : tuple
        Of disc and knob.
    moved : callable
        Called with the new pose; with the heading that it has if there is no knob.
    turns : bool
        Whether there is a knob.
    sphere : bool
        Whether it is a sphere instead of a disc.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        name: str,
        area: Area,
        *,
        radius: float,
        height: float,
        colour: Colour,
        moved: Callable[[Pose], None],
        turns: bool = True,
        sphere: bool = False,
    ) -> None:
        self._moved, self._height, self._area = moved, height, area
        self._pose = Pose(math.inf, math.inf, 0.0)
        self._frame = server.scene.add_frame(name, show_axes=False)
        place, scene, paint = (0.0, 0.0, height / 2.0), server.scene, rgb(colour)
        if sphere:
            scene.add_icosphere(f"{name}/body", radius, paint, position=place).on_drag("left")(self._drag)
        else:
            disc = scene.add_cylinder(f"{name}/body", radius, height, paint, opacity=_OPACITY, position=place)
            disc.on_drag("left")(self._drag)
        if turns:
            knob = server.scene.add_icosphere(
                f"{name}/knob", _KNOB, rgb(colour), position=(radius + _TURNING, 0.0, _KNOB)
            )
            knob.on_drag("left")(self._turn)
        self._reach = radius + _TURNING
        self._offsets: dict[int, tuple[float, float]] = {}

    def show(self, pose: Pose | None) -> None:
        """Show it at a pose; None hides it."""
        if self._frame.visible != (pose is not None):
            self._frame.visible = pose is not None
        if pose is not None and pose != self._pose:
            self._pose = pose
            self._frame.position = (pose.x - self._area.x, pose.y - self._area.y, 0.0)
            self._frame.wxyz = wxyz(pose.yaw)

    def remove(self) -> None:
        """Take it out of the scene."""
        self._frame.remove()

    async def _drag(self, event: Any) -> None:  # a coroutine, so that events come in order
        place = self._pointed(event, self._height)
        if place is None:
            return
        client = event.client.client_id  # each pulls where it has taken hold
        if event.phase == "start":
            self._offsets[client] = (self._pose.x - place[0], self._pose.y - place[1])
        x, y = self._offsets.get(client, (0.0, 0.0))
        if event.phase == "end":
            self._offsets.pop(client, None)
        self._moved(self._pose._replace(x=place[0] + x, y=place[1] + y))

    async def _turn(self, event: Any) -> None:
        place = self._pointed(event, _KNOB)
        if place is not None and place != (self._pose.x, self._pose.y):
            yaw = math.atan2(place[1] - self._pose.y, place[0] - self._pose.x)
            self._moved(self._pose._replace(yaw=yaw))

    def _pointed(self, event: Any, height: float) -> tuple[float, float] | None:
        camera, pointer = _point(event.client.camera.position), _point(event.end_position)
        there = None if camera is None or pointer is None else on_floor(camera, pointer, height)
        return None if there is None else self._area.at(*there)[:2]


def _point(sent: Any) -> FloatArray | None:
    """Return what a client sent as a point (3,) in m; None where it is none."""
    try:
        point = np.asarray(sent, dtype=float)
    except (TypeError, ValueError):
        return None
    return point if point.shape == (3,) else None
