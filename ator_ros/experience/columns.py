"""The columns of tables of experience."""

from __future__ import annotations

from collections.abc import Iterable

from ator_ros.actions.goal_variables import direct_name


class ExperienceError(ValueError):
    """Experience that cannot be used; the message names the file, the field and what was expected."""


LARGEST = 1e9
"""Greatest number in a table: thirty years in s, and beyond `world.messages.FARTHEST` in m."""
STATE_COLUMNS = ("t", "x", "y", "yaw", "v", "w")
"""Time and the robot's state, in the order of a sample: s since the start, m, m, rad, m/s, rad/s."""

_BEFORE = {
    "action": "name of the action",
    "episode": "number of the episode within its action",
    "t": "s since the start of the episode",
    "x": "m, axle",
    "y": "m, axle",
    "yaw": "rad",
    "v": "m/s, forward",
    "w": "rad/s, counter-clockwise",
}
_GOAL = {
    "xg": "m, goal of the axle (hold 0) or of the hold (hold 1)",
    "yg": "m, goal of the axle (hold 0) or of the hold (hold 1)",
    "yawg": "rad, heading at the goal",
    "speedg": "m/s, forward speed at the goal",
}
_AFTER = {
    "hold": "1: the place in the robot's front where it holds objects shall come to (xg, yg); 0: the axle",
    "time_to_go": "s until the action ended",
    "duration": "s, of the whole episode",
    "success": "the action ended well and did what it is for",
    "reason": "how the episode ended",
    "position_error": "m, at the end",
    "heading_error": "rad, at the end; NaN where the heading does not matter",
}


def columns(objects: Iterable[str], goal_variables: Iterable[str] = ()) -> dict[str, str]:
    """Return name and meaning of each column of a table; SI units, world frame.

    Parameters
    ----------
    objects : iterable of str
        The objects whose places it holds.
    goal_variables : iterable of str
        The goal variables that actions declare beyond pose and speed.
    """
    places = {name: f"m, NaN without {name.rpartition('_')[0]}" for name in object_columns(objects)}
    declared = {
        direct_name(name): f"goal variable {name} in its declared unit, NaN of an action without it"
        for name in goal_variables
    }
    return {**_BEFORE, **places, **_GOAL, **declared, **_AFTER}


def object_columns(objects: Iterable[str]) -> list[str]:
    """Return the names of the columns of objects: NAME_x and NAME_y of each, in m, NaN where unknown."""
    return [f"{name}_{axis}" for name in objects for axis in "xy"]


def objects_of_columns(names: Iterable[str]) -> tuple[str, ...]:
    """Return the objects whose two columns are among `names`, in their order."""
    there = list(names)
    found = (name.removesuffix("_x") for name in there if name.endswith("_x") and name != "_x")
    return tuple(name for name in found if f"{name}_y" in there)


def goal_variables_of_columns(names: Iterable[str]) -> tuple[str, ...]:
    """Return the declared goal variables whose columns are among `names`, in their order."""
    suffix = direct_name("")
    found = (name.removesuffix(suffix) for name in names if name.endswith(suffix) and name not in _GOAL)
    return tuple(name for name in found if name)
