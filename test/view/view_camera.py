"""Projection of floor points to pixels of a new client of the view."""

from __future__ import annotations

import math
from io import BytesIO

import numpy as np
from PIL import Image
from view.chromium import Chromium

from ator_ros.robot.description import Robot
from ator_ros.view.scene import camera_over


def seen_at(
    robot: Robot, place: tuple[float, float, float], canvas: tuple[float, float, float, float]
) -> tuple[float, float]:
    """Return the pixel of a point (m) in a canvas: left, top, width, height in pixels."""
    position, look_at, fov = camera_over(robot)
    ahead = np.subtract(look_at, position)
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    up = np.cross(right, ahead)
    ray = np.subtract(place, position)
    left, top, width, height = canvas
    scale = height / 2.0 / math.tan(fov / 2.0) / float(ray @ ahead)
    return left + width / 2.0 + scale * float(ray @ right), top + height / 2.0 - scale * float(ray @ up)


def canvas_of(browser: Chromium) -> tuple[float, float, float, float]:
    left, top, width, height = browser.script(
        "(() => {const r = document.querySelector('canvas').getBoundingClientRect();"
        "return [r.left, r.top, r.width, r.height]})()"
    )
    return left, top, width, height


def red_around(picture: bytes, place: tuple[float, float]) -> float:
    """Return the share of pixels around a place that have the color of the robot's body."""
    x, y = (round(value) for value in place)
    image = np.asarray(Image.open(BytesIO(picture)).convert("RGB"), dtype=int)
    red, green, blue = np.moveaxis(image[y - 25 : y + 25, x - 25 : x + 25], 2, 0)
    return float(np.mean((red > 90) & (red > 2 * green) & (red > 2 * blue)))
