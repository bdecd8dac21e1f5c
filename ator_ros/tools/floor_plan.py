"""The floor in pictures of the tools: surroundings, map, and the numbers of stations."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from ator_ros.bases.description import Robot
from ator_ros.domains.domain import Domain
from ator_ros.nodes.segments import station_labels, surroundings, walls
from ator_ros.tops.chain import TopChain

BLUE = "#1f5fa8"
GRAY = "#8a8f98"
_BESIDE = 4.0  # points between a station and its number


def draw_floor(axes: Axes, domain: Domain, robot: Robot) -> None:
    """Draw the surroundings and the obstacles of the map, in m."""
    for lines in (*surroundings(domain, robot), walls(robot)):
        axes.add_collection(LineCollection(list(lines.points), colors=GRAY, linewidths=0.8))
    axes.set_aspect("equal")


def draw_stations(axes: Axes, chain: TopChain) -> None:
    """Write the number of each station of a round as sent, and its place in the chosen order."""
    for label in station_labels(chain):
        axes.annotate(
            label.text,
            (label.x, label.y),
            xytext=(_BESIDE, _BESIDE),
            textcoords="offset points",
            fontsize=8,
        )
