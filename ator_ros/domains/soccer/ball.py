"""The ball among the objects of a world."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from ator_ros.world.state import ObjectState

BALL = "ball"
"""Name of the ball among the objects of a world and in conditions."""


class _WithObjects(Protocol):
    @property
    def objects(self) -> Mapping[str, ObjectState]: ...


def ball_of(world: _WithObjects) -> ObjectState | None:
    """Return the ball of a world or of a situation; None if there is none."""
    return world.objects.get(BALL)


def objects_of(ball: ObjectState | None) -> dict[str, ObjectState]:
    """Return the objects of a world that contains `ball`, or nothing."""
    return {} if ball is None else {BALL: ball}
