"""The robots of a team as one of them believes: by the messages that it received."""

from __future__ import annotations

import dataclasses
import math

from ator_ros.team.roles import Decision, Member

PERIOD = 0.2
"""Real s between two messages of a robot, and between two decisions."""
CONFLICT = 2.0 * PERIOD
"""Real s after which the later of two robots by name leaves a role that both claim."""


class Roster:
    """The newest message of each robot, and its role.

    A role is the one of the newest message, or of a newer decision. Times are real times on this
    robot's clock; stamps of other robots are not used.

    Attributes
    ----------
    name : str
        This robot.
    timeout : float
        Real s after which a robot without messages drops out.
    """

    def __init__(
        self,
        name: str,
        timeout: float,
        now: float,
    ) -> None:
        self.name = name
        self.timeout = timeout
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

    def members(self, now: float) -> list[Member]:
        """Return the robots that can take a role."""
        newest = self._members.values()
        return [member for member, arrival in newest if now - arrival <= self.timeout]

    def is_listening(self, now: float) -> bool:
        """Return whether messages of teammates may not have come yet, so that no role is taken."""
        return now - self._since < self.timeout

    def barred(self, now: float) -> frozenset[str]:
        """Return the roles that this robot must not take.

        An earlier robot by name keeps claiming them, although it knows that this robot does, too:
        each compares its own newest costs with older ones of the other.
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
    ) -> None:
        """Take the roles of a decision, until newer messages come; `roles` are their names."""
        for name in decision.names:
            member, arrival = self._members[name]
            number = decision.role_of(name)
            role = "" if number is None else roles[number]
            self._members[name] = (dataclasses.replace(member, role=role), arrival)

    def role(self) -> str:
        """Return this robot's role; empty if it has none."""
        found = self._members.get(self.name)
        return "" if found is None else found[0].role
