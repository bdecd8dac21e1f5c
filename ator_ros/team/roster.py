"""The robots of a team as one of them believes: by the messages that it received."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

from ator_ros.team.roles import Course, Decision, Member, places_of

PERIOD = 0.2
"""Real s between two messages of a robot, and between two decisions."""
CONFLICT = 2.0 * PERIOD
"""Real s after which the later of two robots by name leaves a role that both claim."""


class _Begun(NamedTuple):
    """A role that a robot has begun, its places, and the time in s at which it should be done."""

    role: str
    places: tuple[tuple[float, float], ...]
    end: float


class Roster:
    """The newest message of each robot, and its role.

    A role is the one of the newest message, or of a newer decision. Times are real times on this
    robot's clock, or stamps of its own state; those of other robots are not used.

    Attributes
    ----------
    name : str
        This robot.
    timeout : float
        Real s after which a robot without messages drops out.
    reach : float
        Distance in m up to which the places of a role are the same.
    """

    def __init__(
        self,
        name: str,
        timeout: float,
        now: float,
        *,
        reach: float = 0.5,
    ) -> None:
        self.name = name
        self.timeout = timeout
        self.reach = reach
        self._begun: dict[str, _Begun] = {}
        self._since = now
        self._members: dict[str, tuple[Member, float]] = {}
        self._claims: dict[str, str] = {}  # the role in the newest message of each robot
        self._conflict_since = math.inf
        self._barred: set[str] = set()

    def take(
        self,
        member: Member,
        now: float,
        *,
        ready: bool = True,
    ) -> None:
        """Take a robot's message; one that is not `ready` drops out."""
        self._claims[member.name] = member.role
        if ready:
            self._members[member.name] = (member, now)
        else:
            self._members.pop(member.name, None)

    def members(
        self,
        now: float,
        stamp: float = 0.0,
    ) -> list[Member]:
        """Return the robots that can take a role; `stamp` is that of this robot's state in s."""
        found = []
        for member, arrival in self._members.values():
            if now - arrival > self.timeout:
                continue
            begun = self._begun.get(member.name)
            if begun is not None and begun.role == member.role and begun.end > stamp:
                course = Course(begun.places, begun.end - stamp)
                member = dataclasses.replace(member, course=course)
            found.append(member)
        return found

    def is_listening(self, now: float) -> bool:
        """Return whether messages of teammates may not have come yet, so that no role is taken."""
        return now - self._since < self.timeout

    def barred(self, now: float) -> frozenset[str]:
        """Return the roles that this robot must not take.

        An earlier robot by name keeps claiming them, although it knows that this robot does, too:
        they predict the gain of a change a little differently.
        """
        earlier = [each.name for each in self.members(now) if each.name < self.name]
        claimed = {self._claims[name] for name in earlier} - {""}
        role = self.role()
        self._conflict_since = min(self._conflict_since, now) if role in claimed else math.inf
        if now - self._conflict_since >= CONFLICT:
            self._barred.add(role)
        self._barred &= claimed
        return frozenset(self._barred)

    def believe(
        self,
        decision: Decision,
        roles: tuple[str, ...],
        stamp: float = 0.0,
    ) -> None:
        """Take the roles of a decision, until newer messages come; `roles` are their names.

        `stamp` is that of this robot's state in s.
        """
        for name in decision.names:
            member, arrival = self._members[name]
            number = decision.role_of(name)
            role = "" if number is None else roles[number]
            self._members[name] = (dataclasses.replace(member, role=role), arrival)
            self._note(name, decision, role, stamp)

    def _note(
        self,
        name: str,
        decision: Decision,
        role: str,
        stamp: float,
    ) -> None:
        """Note when a robot is expected to be done, if it begins a role or its places jump."""
        number = decision.role_of(name)
        if number is None:
            self._begun.pop(name, None)
            return
        places = places_of(decision.wanted[number])
        end = stamp + float(decision.costs[decision.names.index(name), number])
        begun = self._begun.get(name)
        if begun is None or begun.role != role or begun.end <= stamp:
            begun = _Begun(role, places, end)
        if Course(begun.places, 0.0).leads_to(places, self.reach):
            end = begun.end  # also where an object moves with a robot
        self._begun[name] = _Begun(role, places, end)

    def role(self) -> str:
        """Return this robot's role; empty if it has none."""
        found = self._members.get(self.name)
        return "" if found is None else found[0].role
