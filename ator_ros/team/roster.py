"""The robots of a team as one of them believes: by the messages that it received."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

from ator_ros.refinement.gate import Gate
from ator_ros.team.role_file import Role
from ator_ros.team.roles import USUAL_GATE, Decision, Member, decide

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
        self._wanted: dict[str, tuple[int | None, float]] = {}  # what pays, and since when
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
        """Return the robots that can take a role; what they have begun ends earlier by now."""
        ages = [(member, now - arrival) for member, arrival in self._members.values()]
        return [_after(member, age) for member, age in ages if age <= self.timeout]

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

    def decide(
        self,
        roles: Sequence[Role],
        now: float,
        gate: Gate = USUAL_GATE,
    ) -> Decision:
        """Decide who takes which role, and take that for true until newer messages come.

        A change of roles must pay until a message of every teammate has come since it first paid:
        the costs before may be those of another situation, such as with the ball elsewhere.
        """
        members = self.members(now)
        wanted = decide(members, roles, gate)
        for name, role in zip(wanted.names, wanted.assignment.roles, strict=True):
            if name not in self._wanted or self._wanted[name][0] != role:
                self._wanted[name] = (role, now)
        others = [self._members[each.name][1] for each in members if each.name != self.name]
        oldest = min(others, default=math.inf)
        settled = {each.name for each in members if self._wanted[each.name][1] < oldest}
        decision = decide(members, roles, gate, settled)
        for name in decision.names:
            member, arrival = self._members[name]
            number = decision.role_of(name)
            role_name = "" if number is None else roles[number].name
            self._members[name] = (dataclasses.replace(member, role=role_name), arrival)
        return decision

    def role(self) -> str:
        """Return this robot's role; empty if it has none."""
        found = self._members.get(self.name)
        return "" if found is None else found[0].role


def _after(
    member: Member,
    age: float,
) -> Member:
    """Return a robot some s after its message: what it does in its role costs that much less."""
    bid = member.bids.get(member.role)
    if bid is None:
        return member
    left = bid._replace(cost=max(bid.cost - age, 0.0))
    return dataclasses.replace(member, bids={**member.bids, member.role: left})
