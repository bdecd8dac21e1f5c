"""Deviation of the world from the last refinement request."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from ator_ros.execution.remaining import awaited
from ator_ros.geometry import FloatArray, Pose
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.objects import at_rest, is_at_front
from ator_ros.world.state import ObjectState, World

Way = Callable[[], FloatArray | None]


class ToldWorld:
    """Compares objects with where they were expected, and the robot with its way.

    Parameters
    ----------
    robot : Robot
        Its sizes, and the deceleration of rolling objects.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._expected: Mapping[str, ObjectState] = {}
        self._way: FloatArray | None = None
        self._call: tuple[int, TopCall] | None = None

    def told(self, world: World) -> None:
        """Compare with this world from now on, and with the way that is followed then."""
        self._expected = world.objects
        self._call = None

    def beyond(self, most: float, world: World, chain: TopChain, step: int, way: Way) -> str:
        """Return in words what differs by more than `most` (m) from what was told; empty: nothing does.

        Objects are compared where they come to rest, those that the robot itself moves excepted.

        Parameters
        ----------
        most : float
            Distance in m.
        world : World
            The present state.
        chain, step
            The chain, and the step being executed, from 0.
        way : callable
            Returns the planned way of the action under way; see `Action.way`.
        """
        resting = at_rest(world, self._robot)
        for _, name in awaited(chain.calls[step:]):
            there, expected = resting.objects.get(name), self._expected.get(name)
            if there is None or is_at_front(world, self._robot, name):
                continue
            if expected is None:
                return f"the {name} was not known"
            moved = math.hypot(there.x - expected.x, there.y - expected.y)
            if moved > most:
                return f"the {name} comes to rest {moved:.2f} m from the forecast"
        off = self._off(world.robot.pose, (step, chain.calls[step]), way)
        return f"the robot is {off:.2f} m off its way" if off > most else ""

    def _off(self, pose: Pose, call: tuple[int, TopCall], way: Way) -> float:
        """Return the distance in m from the way as it was when `call` or what was told last changed."""
        if self._way is None or call != self._call:
            self._way, self._call = way(), call
        return 0.0 if self._way is None else _distance(pose, self._way)


def _distance(pose: Pose, way: FloatArray) -> float:
    """Return the distance in m from a pose to the polygon through the positions of a way."""
    points = way[:, :2] - (pose.x, pose.y)
    begins, along = points[:-1], np.diff(points, axis=0)
    squares = np.maximum((along**2).sum(axis=1), 1e-12)
    shares = np.clip(-(begins * along).sum(axis=1) / squares, 0.0, 1.0)
    nearest = np.vstack([points[-1:], begins + shares[:, None] * along])
    return float(np.hypot(nearest[:, 0], nearest[:, 1]).min())
