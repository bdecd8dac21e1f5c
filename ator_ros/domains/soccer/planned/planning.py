"""Planning in portions, so that no tick takes long: what does not fit into one goes on in the next."""

from __future__ import annotations

from collections.abc import Generator
from typing import TypeAlias, TypeVar

from ator_ros.domains.soccer.planned.manoeuvre import Manoeuvre
from ator_ros.domains.soccer.planned.opening import Opening
from ator_ros.world.state import World

Found = TypeVar("Found")

Planning: TypeAlias = Generator[int | Manoeuvre, None, Found]
"""Work in portions: yields what each one will cost in points; returns what was found.

A manoeuvre that is yielded is good enough for a robot in motion, which had better not wait for the rest.

A point is 90 µs or less, mostly 60 µs. Points are counted, not measured, so that every computer plans alike.
"""

SLICE = 320
"""Points in a tick: a portion that would cost more than is left of them waits for the next one."""
_MOVED = 0.01  # m
_TURNED = 0.02  # rad


class Search:
    """A plan in the making.

    Parameters
    ----------
    world : World
        The state that is planned from.
    opening : Opening
        What comes before the manoeuvre.
    planning : Planning
        Finds the manoeuvre.
    standing : bool
        Whether the robot stands, whatever noise odometry has, and so can wait for the best manoeuvre.
    """

    def __init__(
        self, world: World, opening: Opening, planning: Planning[Manoeuvre], *, standing: bool
    ) -> None:
        self.opening = opening
        self._start, self._planning, self._standing = world.robot, planning, standing
        self._advanced: float | None = None
        self._good: Manoeuvre | None = None
        self._due: int | None = None  # points of the portion that comes next

    def advance(self, time: float, paid: list[int] | None = None) -> Manoeuvre | None:
        """Search for a slice, once at each `time` (s); None where there is no result yet.

        The points of each portion are added to `paid`.

        Raises
        ------
        ActionError
            There is no way.
        """
        if time == self._advanced:
            return None
        self._advanced = time
        paid = [] if paid is None else paid
        try:
            if self._due is None:
                self._due = self._cost_of_next()
            while not paid or sum(paid) + self._due <= SLICE:
                paid.append(self._due)
                self._due = self._cost_of_next()
        except StopIteration as done:
            found: Manoeuvre = done.value
            return found
        return None if self._standing else self._good

    def _cost_of_next(self) -> int:
        """Do the portion that was paid for; return what the next one costs."""
        while isinstance(portion := next(self._planning), Manoeuvre):
            self._good = portion
        return portion

    def holds(self, world: World) -> bool:
        """Return whether the robot still stands where the plan is to begin."""
        start, pose = self._start, world.robot.pose
        turned = abs(start.pose.relative(pose).yaw)
        return self._standing and start.pose.distance(pose) <= _MOVED and turned <= _TURNED
