"""Planning in slices, so that no tick takes long: a search that does not fit continues in the next."""

from __future__ import annotations

from collections.abc import Generator
from typing import TypeAlias, TypeVar

from ator_ros.motion.manoeuvre import Manoeuvre
from ator_ros.motion.trajectory import Opening
from ator_ros.world.state import World

Found = TypeVar("Found")

Planning: TypeAlias = Generator[int | Manoeuvre, None, Found]
"""Work in batches: yields the cost of the next batch in points; returns the result.

It may also yield a manoeuvre that is good enough for a robot in motion, which should not wait for the rest.

A point is 90 µs or less, mostly 60 µs. Points are counted, not measured, so that every computer plans alike.
"""

SLICE = 320
"""Points per tick: a batch that costs more than is left of them waits for the next tick."""
_MOVED = 0.01  # m
_TURNED = 0.02  # rad
_ROUNDING = 1e-6  # s by which sums of ticks may be off


class Search:
    """A search for a manoeuvre, over several ticks if need be.

    Parameters
    ----------
    world : World
        The state from which the robot starts.
    opening : Opening
        The motion before the manoeuvre.
    standing : bool
        Whether the robot stands (up to the noise of odometry), and so can wait for the best manoeuvre.

    Attributes
    ----------
    opening : Opening
        The motion before the manoeuvre.
    begun : float
        When the search began, in s of the world's time.
    """

    def __init__(
        self, world: World, opening: Opening, planning: Planning[Manoeuvre], *, standing: bool
    ) -> None:
        self.opening = opening
        self._start, self._planning, self._standing = world.robot, planning, standing
        self.begun = world.time
        self._advanced: float | None = None
        self._good: Manoeuvre | None = None
        self._due: int | None = None  # points of the batch that comes next

    def advance(self, time: float) -> Manoeuvre | None:
        """Search for one slice, at most once per `time` (s); return the manoeuvre, None if not found yet.

        Raises
        ------
        ActionError
            No manoeuvre exists.
        """
        if time == self._advanced:
            return None
        self._advanced = time
        paid = 0
        try:
            if self._due is None:
                self._due = self._cost_of_next()
            while paid == 0 or paid + self._due <= SLICE:
                paid += self._due
                self._due = self._cost_of_next()
        except StopIteration as done:
            found: Manoeuvre = done.value
            return found
        return None if self._standing else self._good

    def _cost_of_next(self) -> int:
        """Run the next batch; return the cost of the one after it in points."""
        while isinstance(batch := next(self._planning), Manoeuvre):
            self._good = batch
        return batch

    def is_in_opening(self, world: World) -> bool:
        """Return whether the robot moves, and is still in the opening."""
        return not self._standing and world.time < self.begun + self.opening.duration - _ROUNDING

    def is_still_valid(self, world: World) -> bool:
        """Return whether the robot still stands where the plan is to begin."""
        start, pose = self._start, world.robot.pose
        turned = abs(start.pose.relative(pose).yaw)
        return self._standing and start.pose.distance(pose) <= _MOVED and turned <= _TURNED
