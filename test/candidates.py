"""Candidates of a search, found in one go."""

from __future__ import annotations

from collections.abc import Sequence

from ator_ros.geometry import Pose
from ator_ros.motion.manoeuvre import Side
from ator_ros.motion.planning import Found, Planning
from ator_ros.motion.search import Candidates, find_candidates, ways_to_drive
from ator_ros.robot.description import Limits


def result(planning: Planning[Found]) -> Found:
    """Return what a search finds."""
    try:
        while True:
            next(planning)
    except StopIteration as done:
        found: Found = done.value
        return found


def candidates_between(
    start: Pose,
    goal: Pose,
    entries: Sequence[Side],
    exits: Sequence[Side],
    limits: Limits,
    **bounds: float,
) -> Candidates:
    """Return the manoeuvres between two poses; `bounds` are those of `find_candidates`."""
    ways = result(ways_to_drive(entries, exits, limits))
    return result(find_candidates(start, goal, ways, **bounds))
