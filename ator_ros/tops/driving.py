"""TOPs that only drive the robot to a pose."""

from __future__ import annotations

from ator_ros.tops.conditions import Condition
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.top import Top

_PLACE = {"robot.x", "robot.y", "robot.yaw"}


def driving_top(library: TopLibrary) -> Top | None:
    """Return the first TOP that drives the robot to a pose whatever the situation is; None without one."""
    return next((top for top in library.values() if _drives(top)), None)


def _drives(top: Top) -> bool:
    placed = {term.variable for term in top.post.terms if str(term.target).startswith("goal.")}
    return top.pre == Condition() and placed >= _PLACE
