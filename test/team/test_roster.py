"""The robots of a team by the messages that one of them received: losses, restarts, conflicts."""

import dataclasses

import pytest

from ator_ros.geometry import Pose
from ator_ros.team.role_file import Role, RoleStep
from ator_ros.team.roles import Bid, Member
from ator_ros.team.roster import CONFLICT, Roster
from ator_ros.world.state import RobotState, World

TIMEOUT = 1.0
ROLES = [Role(name, (RoleStep("goToPose"),)) for name in ("ball", "support")]


def member(name: str, role: str = "", stamp: float = 0.0, ball: float = 5.0) -> Member:
    """Return a robot with what the roles cost it in s."""
    bids = {"ball": Bid(ball, 0.1, (0.0, 0.0)), "support": Bid(3.0, 0.1, (2.0, 0.0))}
    return Member(name, World(stamp, RobotState(Pose(0.0, 0.0, 0.0))), 0.3, role, bids)


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
    roster.decide(ROLES, 10.0)
    assert roster.role() == "ball"
    assert roles(roster, 10.1) == {"ann": "ball", "bob": "support"}
    roster.take(member("bob", "ball", ball=4.0), 10.2)
    assert roles(roster, 10.3) == {"ann": "ball", "bob": "ball"}
    roster.decide(ROLES, 10.3)
    assert roles(roster, 10.4) == {"ann": "support", "bob": "ball"}


def test_a_change_must_pay_until_each_teammate_has_sent_a_message(roster: Roster) -> None:
    bob = member("bob", "support")
    eve = member("eve", ball=9.0)
    roster.take(eve, 10.0)
    roster.decide(ROLES, 10.0)
    for other, now, role in (
        (None, 10.2, "ball"),
        (bob, 10.3, "ball"),
        (None, 10.4, "ball"),
        (eve, 10.5, "support"),
    ):
        roster.take(member("ann", roster.role(), ball=9.0), now)
        if other is not None:
            roster.take(other, now)
        roster.decide(ROLES, now)
        assert roster.role() == role


def test_a_gain_that_ends_with_the_next_message_changes_nothing(roster: Roster) -> None:
    roster.decide(ROLES, 10.0)
    for now, ball in ((10.2, 9.0), (10.3, 5.0), (10.4, 9.0), (10.5, 5.0)):
        roster.take(member("bob", "support", ball=5.0), now - 0.05)
        roster.take(member("ann", "ball", ball=ball), now)
        roster.decide(ROLES, now)
        assert roster.role() == "ball"


def test_a_role_that_cannot_be_kept_changes_at_once(roster: Roster) -> None:
    roster.decide(ROLES, 10.0)
    ann = member("ann", "ball")
    roster.take(dataclasses.replace(ann, bids={"support": ann.bids["support"]}), 10.2)
    roster.decide(ROLES, 10.2)
    assert roles(roster, 10.2) == {"ann": "support", "bob": "ball"}


def test_what_a_robot_has_begun_ends_earlier_as_time_passes(roster: Roster) -> None:
    roster.take(member("ann", "support", ball=9.0), 10.0)
    roster.take(member("bob", "ball", ball=0.7), 10.0)
    for now, left in ((10.0, 0.7), (10.5, 0.2), (10.9, 0.0)):
        roster.decide(ROLES, now)
        (bids,) = [each.bids for each in roster.members(now) if each.name == "bob"]
        assert bids["ball"].cost == pytest.approx(left)
        assert bids["support"].cost == 3.0


def test_a_restarted_robot_has_no_role(roster: Roster) -> None:
    roster.decide(ROLES, 10.0)
    roster.take(member("bob"), 10.3)
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
    """Each finds itself the cheaper one by far; the first messages of each are lost."""
    rosters = {name: Roster(name, TIMEOUT, now=-TIMEOUT) for name in ("ann", "bob")}
    sent = dict.fromkeys(rosters, 0)
    since = longest = 0.0
    for tick in range(40):
        now = 0.1 * tick
        name, other = ("ann", "bob") if tick % 2 == 0 else ("bob", "ann")
        roster = rosters[name]
        barred = roster.barred(now)
        own = member(name, roster.role(), ball=1.0)
        bids = {role: bid for role, bid in own.bids.items() if role not in barred}
        roster.take(dataclasses.replace(own, bids=bids), now)
        roster.decide(ROLES, now)
        sent[name] += 1
        if sent[name] > lost:
            rosters[other].take(member(name, roster.role(), ball=50.0), now)
        if [each.role() for each in rosters.values()] != ["ball", "ball"]:
            since = now
        longest = max(longest, now - since)
    assert 0.0 < longest <= 0.8 + 0.2 * lost
    assert [each.role() for each in rosters.values()] == ["ball", "support"]
