"""The robots of a team by the messages that one of them received: losses, restarts, conflicts."""

import dataclasses

import pytest

from ator_ros.geometry import Pose
from ator_ros.team.assignment import Assignment
from ator_ros.team.roles import Decision, Member
from ator_ros.team.roster import CONFLICT, Roster
from ator_ros.world.state import RobotState, World

TIMEOUT = 1.0


def member(name: str, role: str = "", stamp: float = 0.0) -> Member:
    return Member(name, World(stamp, RobotState(Pose(0.0, 0.0, 0.0))), 0.3, role)


def decision(*roles: int | None) -> Decision:
    """Return a decision for the robots ann, bob and eve."""
    names = ("ann", "bob", "eve")[: len(roles)]
    return Decision(names, Assignment(roles), (False,) * len(names))


@pytest.fixture
def roster() -> Roster:
    made = Roster("ann", TIMEOUT, now=0.0)
    made.take(member("ann"), 10.0)
    made.take(member("bob"), 10.0)
    return made


def names(roster: Roster, now: float) -> list[str]:
    return sorted(each.name for each in roster.members(now))


def roles(roster: Roster, now: float) -> dict[str, str]:
    return {each.name: each.role for each in roster.members(now)}


def test_a_robot_without_messages_drops_out_and_comes_back(roster: Roster) -> None:
    roster.take(member("ann"), 11.0)
    assert names(roster, 11.0) == ["ann", "bob"]
    assert names(roster, 11.01) == ["ann"]
    roster.take(member("bob"), 12.1)
    assert names(roster, 12.1) == ["bob"]


def test_a_robot_that_is_not_ready_drops_out_at_once(roster: Roster) -> None:
    roster.take(member("bob", "ball"), 10.2, ready=False)
    assert names(roster, 10.2) == ["ann"]


def test_the_clocks_of_the_robots_need_not_agree(roster: Roster) -> None:
    for stamp in (-0.1, 0.1, 1e9):
        roster.take(member("bob", stamp=stamp), 10.5)
        assert "bob" in names(roster, 10.6)


def test_a_decision_counts_until_newer_messages_come(roster: Roster) -> None:
    roster.believe(decision(0, 1), ("ball", "support"))
    assert roster.role() == "ball"
    assert roles(roster, 10.1) == {"ann": "ball", "bob": "support"}
    roster.take(member("bob", "ball"), 10.2)
    assert roles(roster, 10.3) == {"ann": "ball", "bob": "ball"}
    roster.believe(decision(None, 0), ("ball", "support"))
    assert roles(roster, 10.4) == {"ann": "", "bob": "ball"}


def test_a_restarted_robot_has_no_role(roster: Roster) -> None:
    roster.believe(decision(None, 0), ("ball", "support"))
    roster.take(dataclasses.replace(member("bob"), role=""), 10.3)
    assert roles(roster, 10.3)["bob"] == ""


def test_a_robot_that_has_just_started_listens(roster: Roster) -> None:
    assert roster.is_listening(0.9)
    assert not roster.is_listening(1.0)


@pytest.mark.parametrize(("other", "barred"), [("abe", {"ball"}), ("bob", set())])
def test_the_later_of_two_robots_that_go_on_claiming_a_role_leaves_it(
    roster: Roster, other: str, barred: set[str]
) -> None:
    roster.take(member("ann", "ball"), 10.0)
    for now in (10.0, 10.2):
        roster.take(member(other, "ball"), now)
        assert not roster.barred(now)
    assert roster.barred(10.0 + CONFLICT) == barred
    roster.take(member("ann", "support"), 10.6)
    assert roster.barred(10.6) == barred
    roster.take(member(other, "support"), 10.8)
    assert not roster.barred(10.8)


def test_a_conflict_that_ends_by_itself_bars_nothing(roster: Roster) -> None:
    roster.take(member("ann", "ball"), 10.0)
    for now, role in ((10.0, "ball"), (10.2, "support"), (10.4, "ball"), (10.5, "ball")):
        roster.take(member("abe", role), now)
        assert not roster.barred(now)


@pytest.mark.parametrize("lost", range(4))
def test_robots_that_never_agree_have_one_role_for_at_most_the_stated_time(lost: int) -> None:
    """Both want the ball; the first messages of each are lost."""
    rosters = {name: Roster(name, TIMEOUT, now=-TIMEOUT) for name in ("ann", "bob")}
    sent = dict.fromkeys(rosters, 0)
    since = longest = 0.0
    for tick in range(40):
        now = 0.1 * tick
        name, other = ("ann", "bob") if tick % 2 == 0 else ("bob", "ann")
        roster = rosters[name]
        barred = roster.barred(now)
        roster.take(member(name, roster.role()), now)
        role = 1 if "ball" in barred else 0
        known = names(roster, now)
        wanted = [role if each == name else 1 - role for each in known]
        found = dataclasses.replace(decision(0, 1), names=tuple(known))
        found = dataclasses.replace(found, assignment=Assignment(tuple(wanted)))
        roster.believe(found, ("ball", "support"))
        sent[name] += 1
        if sent[name] > lost:
            rosters[other].take(member(name, roster.role()), now)
        if [each.role() for each in rosters.values()] != ["ball", "ball"]:
            since = now
        longest = max(longest, now - since)
    assert 0.0 < longest <= 0.8 + 0.2 * lost
    assert [each.role() for each in rosters.values()] == ["ball", "support"]
