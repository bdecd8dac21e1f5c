"""The ball among the objects of a world."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from ator_ros.world.state import ObjectState

BALL = "ball"
"""Its name, in conditions too."""


class _WithObjects(Protocol):
    @property
    def objects(self) -> Mapping[str, ObjectState]: ...


def ball_of(world: _WithObjects) -> ObjectState | None:
    """Return the ball of a world or of a situation, None where there is none."""
    return world.objects.get(BALL)


def objects_of(ball: ObjectState | None) -> dict[str, ObjectState]:
    """Return the objects of a world with at most a ball."""
    return {} if ball is None else {BALL: ball}
