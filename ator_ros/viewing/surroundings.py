"""The surroundings of a robot as shapes: its area, the bays, and the lines that the domain draws."""

from __future__ import annotations

from ator_ros.domains.domain import Domain
from ator_ros.geometry import Pose
from ator_ros.robot.description import Robot
from ator_ros.viewing.shapes import GREY, WHITE, Segments, polyline, rectangle
from ator_ros.world.scene import WALL_THICKNESS, Bay

_LINE = 0.03


def surroundings(domain: Domain, robot: Robot) -> tuple[Segments, ...]:
    """Return the lines on the floor, and the walls of the bays as thick lines."""
    lines = [polyline("area", rectangle(*robot.scene.area.lines), WHITE, _LINE)]
    lines += [
        polyline(f"line{number}", corners, WHITE, _LINE) for number, corners in enumerate(domain.lines(robot))
    ]
    return (*lines, *(_bay(number, bay) for number, bay in enumerate(robot.scene.bays)))


def _bay(number: int, bay: Bay) -> Segments:
    front, side = Pose(bay.x, bay.y, bay.yaw), bay.width / 2.0
    places = ((0.0, side), (bay.depth, side), (bay.depth, -side), (0.0, -side))
    corners = [front.compose(Pose(x, y, 0.0)) for x, y in places]
    return polyline(f"bay{number}", [(corner.x, corner.y) for corner in corners], GREY, WALL_THICKNESS)
