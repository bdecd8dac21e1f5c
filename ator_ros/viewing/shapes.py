"""What a view draws on the floor, for a page in the browser and for RViz alike."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ator_ros.geometry import FloatArray, Pose

Colour = tuple[float, float, float]
"""Red, green and blue, each from 0 to 1."""

GREY: Colour = (0.55, 0.57, 0.6)
BLUE: Colour = (0.13, 0.45, 0.9)
ORANGE: Colour = (0.95, 0.5, 0.1)
VIOLET: Colour = (0.6, 0.45, 0.75)
YELLOW: Colour = (1.0, 0.82, 0.24)
WHITE: Colour = (0.93, 0.94, 0.95)


@dataclass(frozen=True, eq=False)
class Segments:
    """Straight segments on the floor.

    Attributes
    ----------
    name : str
        Unique in a picture.
    points : ndarray, shape (n, 2, 2)
        Both ends of each segment, x and y in m.
    colours : ndarray, shape (n, 3)
        Colour of each segment.
    width : float
        In m.
    """

    name: str
    points: FloatArray
    colours: FloatArray
    width: float = 0.02


@dataclass(frozen=True, slots=True)
class Arrow:
    """An arrow on the floor that starts at a pose (m, rad), `length` m long."""

    name: str
    pose: Pose
    colour: Colour
    length: float = 0.4


Shape = Segments | Arrow


def polyline(name: str, corners: Sequence[tuple[float, float]], colour: Colour, width: float) -> Segments:
    """Return the segments between neighbouring `corners` (m); fewer than two make none."""
    line = np.asarray(corners, dtype=float).reshape(-1, 2)
    points = np.stack([line[:-1], line[1:]], axis=1) if len(line) > 1 else np.zeros((0, 2, 2))
    return Segments(name, points, np.tile(np.asarray(colour, dtype=float), (len(points), 1)), width)


def rectangle(x_min: float, y_min: float, x_max: float, y_max: float) -> list[tuple[float, float]]:
    """Return the closed outline of a rectangle (m)."""
    return [(x_min, y_min), (x_max, y_min), (x_max, y_max), (x_min, y_max), (x_min, y_min)]


def circle(x: float, y: float, radius: float, corners: int = 48) -> list[tuple[float, float]]:
    """Return the closed outline of a circle (m) as a polygon."""
    angles = (2.0 * math.pi * corner / corners for corner in range(corners + 1))
    return [(x + radius * math.cos(angle), y + radius * math.sin(angle)) for angle in angles]
