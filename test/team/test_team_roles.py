"""Who takes which role: soccer with the shipped models, and the file of roles."""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from ator_ros.evaluation.toolset import Toolset, ToolsetSource, tools_of
from ator_ros.files import FileError
from ator_ros.geometry import Pose
from ator_ros.refinement.gate import Gate
from ator_ros.resources import resource_path
from ator_ros.team.role_file import Role, RoleStep, load_roles
from ator_ros.team.roles import (
    Bid,
    Course,
    Decision,
    Member,
    Plan,
    as_observed,
    bids_of,
    common_objects,
    course_in,
    decide,
    plan_roles,
)
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import ObjectState, RobotState, World

BALL = Role("ball", (RoleStep("goToBall", at="ball", open=("yaw",)),))
LEFT = Role("left", (RoleStep("goToPose", x=0.0, y=2.0),))
MIDDLE = ObjectState(0.0, 0.0)


@pytest.fixture(scope="module")
def tools() -> tuple[Toolset, TopLibrary]:
    return tools_of(ToolsetSource())


@dataclasses.dataclass
class Team:
    """Robots that decide with the shipped models of soccer."""

    tools: Toolset
    library: TopLibrary

    def member(
        self, name: str, x: float, y: float = 0.0, role: str = "", ball: ObjectState | None = MIDDLE
    ) -> Member:
        """Return a robot that stands and faces the middle of the field."""
        pose = Pose(x, y, math.atan2(-y, -x))
        objects = {} if ball is None else {"ball": ball}
        reach = self.library.robot.reach
        return Member(name, World(0.0, RobotState(pose), objects), reach, role)

    def plans(
        self, member: Member, roles: list[Role], others: Sequence[Member] = (), **options: Any
    ) -> dict[str, Plan]:
        """Return how a robot would act in each role, with the objects that all observe."""
        objects = common_objects([member, *others], self.library.robot)
        return plan_roles(
            member.world, roles, self.tools.refiner(), self.library, objects, **options
        )

    def bidding(self, members: Sequence[Member], roles: list[Role]) -> list[Member]:
        """Return the robots with what the roles cost each of them."""
        return [
            dataclasses.replace(each, bids=bids_of(self.plans(each, roles, members)))
            for each in members
        ]

    def decide(self, members: Sequence[Member], roles: list[Role]) -> Decision:
        return decide(self.bidding(members, roles), roles)

    def roles(self, members: Sequence[Member], roles: list[Role]) -> dict[str, str]:
        """Return the role of each robot that has one."""
        return named(self.decide(members, roles), roles)


def named(found: Decision, roles: list[Role]) -> dict[str, str]:
    """Return the names of the roles of robots that have one."""
    numbers = {name: found.role_of(name) for name in found.names}
    return {name: roles[role].name for name, role in numbers.items() if role is not None}


def tops_of(plan: Plan) -> list[str]:
    assert plan.chain is not None
    return [call.top.name for call in plan.chain.calls]


def goal_of(plan: Plan) -> Pose:
    """Return where the first step of a plan leads."""
    assert plan.chain is not None
    return plan.chain.calls[0].goal.pose


def cost_of(plan: Plan) -> float:
    assert plan.bid is not None
    return plan.bid.cost


@pytest.fixture(scope="module")
def team(tools: tuple[Toolset, TopLibrary]) -> Team:
    return Team(*tools)


def test_the_nearer_of_two_robots_that_face_the_ball_goes(team: Team) -> None:
    members = [team.member("ann", -3.0), team.member("bob", 1.0)]
    assert team.roles(members, [BALL]) == {"bob": "ball"}


def test_a_robot_keeps_its_role_as_long_as_the_difference_is_uncertain(team: Team) -> None:
    ann = team.member("ann", -2.01)
    bob = team.member("bob", 2.0, role="ball")
    assert team.roles([ann, bob], [BALL]) == {"bob": "ball"}
    near = team.member("ann", -1.0)
    assert team.roles([near, bob], [BALL]) == {"ann": "ball"}
    held = team.decide([ann, team.member("bob", 2.02, role="ball")], [BALL])
    assert 0.0 < held.assignment.gain <= max(held.assignment.uncertainty, Gate().least)


def test_the_order_in_which_robots_are_listed_changes_nothing(team: Team) -> None:
    members = [team.member("ann", -2.0, 0.4), team.member("bob", 2.0), team.member("eve", 0.0, 1.5)]
    one = team.roles(members, [BALL, LEFT])
    assert team.roles(members[::-1], [BALL, LEFT]) == one


def test_robots_that_have_the_same_bids_decide_alike_whatever_they_observe(team: Team) -> None:
    members = team.bidding([team.member("ann", -2.0), team.member("bob", 1.5)], [BALL, LEFT])
    blind = [
        dataclasses.replace(each, world=World(9.0, RobotState(Pose(0.0, 0.0, 0.0))))
        for each in members
    ]
    assert decide(members, [BALL, LEFT]) == decide(blind, [BALL, LEFT])


def test_a_slower_robot_that_is_nearer_does_not_get_the_role() -> None:
    roles = [BALL]
    ann, bob = (
        Member(name, World(0.0, RobotState(Pose(x, 0.0, 0.0))), 0.3, bids={"ball": bid})
        for name, x, bid in (
            ("ann", -3.0, Bid(3.0, 0.2, (0.0, 0.0))),
            ("bob", -1.0, Bid(5.0, 0.2, (0.0, 0.0))),
        )
    )
    assert named(decide([ann, bob], roles), roles) == {"ann": "ball"}


def test_a_robot_in_its_role_goes_on_as_was_predicted_when_it_began(team: Team) -> None:
    ann = team.member("ann", -2.0, role="ball")
    fresh = cost_of(team.plans(ann, [BALL])["ball"])
    left = fresh - 1.0
    here = ((MIDDLE.x, MIDDLE.y),)
    for course, cost in (
        (Course("ball", here, left), left),
        (Course("ball", ((3.0, 0.0),), left), fresh),
        (Course("left", here, left), fresh),
        (Course("ball", here, -1.0), fresh),
    ):
        plan = team.plans(ann, [BALL], course=course)["ball"]
        assert cost_of(plan) == pytest.approx(cost)


def test_a_course_keeps_its_end_unless_the_role_or_its_places_change(team: Team) -> None:
    plan = team.plans(team.member("ann", -2.0), [BALL])["ball"]
    begun = course_in("ball", plan, None, 10.0, 0.3)
    assert begun == Course("ball", ((MIDDLE.x, MIDDLE.y),), 10.0 + cost_of(plan))
    assert course_in("ball", plan, begun, 11.0, 0.3) == begun
    for before in (
        begun._replace(role="left"),
        begun._replace(places=((1.0, 0.0),)),
        begun._replace(end=10.5),
    ):
        again = course_in("ball", plan, before, 11.0, 0.3)
        assert again == begun._replace(end=begun.end + 1.0)
    assert course_in("ball", Plan(()), begun, 11.0, 0.3) is None


def test_equal_costs_are_decided_by_name(team: Team) -> None:
    members = [team.member("bob", 1.5), team.member("ann", 1.5)]
    assert team.roles(members, [BALL]) == {"ann": "ball"}


def test_a_robot_without_a_holder_or_without_the_ball_does_not_get_the_role(team: Team) -> None:
    robot = dataclasses.replace(team.library.robot, holder=None)
    tools = dataclasses.replace(team.tools, robot=robot)
    bare = Team(tools, team.tools.domain.library(robot))
    near = team.member("bob", 1.0, role="ball")
    assert set(bids_of(bare.plans(near, [BALL, LEFT]))) == {"left"}
    far = team.member("ann", -3.0)
    blind = team.member("bob", 1.0, role="ball", ball=None)
    assert team.roles([far, blind], [BALL, LEFT]) == {"ann": "ball", "bob": "left"}


def test_a_robot_does_not_bid_for_a_role_that_it_must_not_take(team: Team) -> None:
    plans = team.plans(team.member("bob", 1.0, role="ball"), [BALL, LEFT], barred={"ball"})
    assert set(bids_of(plans)) == {"left"}


def test_a_role_beside_an_object_that_nobody_observes_is_not_taken(team: Team) -> None:
    assert team.roles([team.member("ann", 1.0, ball=None)], [BALL, LEFT]) == {"ann": "left"}


def test_the_weight_of_a_role_decides_whose_second_counts(team: Team) -> None:
    members = [team.member("ann", 0.3, 1.9), team.member("bob", 0.0, 3.4)]
    here = Role("here", (RoleStep("goToPose", x=0.0, y=1.0, open=("yaw",)),))
    there = Role("there", (RoleStep("goToPose", x=0.3, y=1.9, yaw=-1.7),))
    assert team.roles(members, [here, there]) == {"bob": "here", "ann": "there"}
    heavy = dataclasses.replace(here, weight=20.0)
    assert team.roles(members, [heavy, there]) == {"ann": "here", "bob": "there"}


def test_the_better_alternative_counts(team: Team) -> None:
    behind = RoleStep("goToPose", at="ball", x=-1.0, open=("yaw",))
    ahead = dataclasses.replace(behind, x=1.0)
    role = Role("beside", (behind,), ((ahead,),))
    for x in (-2.0, 2.0):
        plan = team.plans(team.member("ann", x), [role])["beside"]
        assert goal_of(plan).x == pytest.approx(math.copysign(1.0, x))


def test_a_robot_goes_on_to_an_alternative_that_is_no_longer_the_best(team: Team) -> None:
    behind = RoleStep("goToPose", at="ball", x=-1.0, open=("yaw",))
    role = Role("beside", (behind,), ((dataclasses.replace(behind, x=1.0),),))
    running = team.plans(team.member("ann", -2.0), [role])["beside"].chain
    assert running is not None
    later = team.plans(team.member("ann", 2.0), [role])["beside"]
    assert later.goes_on(running, 0.1)
    moved = team.plans(team.member("ann", 2.0, ball=ObjectState(0.2, 0.0)), [role])["beside"]
    assert not moved.goes_on(running, 0.1)


def test_steps_that_are_done_cost_nothing(team: Team) -> None:
    ann = team.member("ann", 1.0)
    hold = team.library.robot.hold_point(ann.world.robot.pose)
    holding = team.member("ann", 1.0, ball=ObjectState(hold.x, hold.y))
    done = team.plans(holding, [BALL])["ball"]
    assert done.bid == (0.0, 0.0, ann.world.robot.pose[:2])
    further = Role("carry", (*BALL.steps, RoleStep("dribbleBall", x=2.0)))
    assert tops_of(team.plans(holding, [further])["carry"]) == ["dribbleBall"]


def test_a_robot_at_a_place_with_an_open_heading_is_done(team: Team) -> None:
    here = Role("here", (RoleStep("goToPose", x=1.0, open=("yaw",)),))
    assert cost_of(team.plans(team.member("ann", 1.0), [here])["here"]) == 0.0


def test_the_robot_is_sent_to_the_ball_that_it_observes(team: Team) -> None:
    rolling = team.member("ann", -1.0, ball=ObjectState(0.1, 0.0, 0.5, 0.0))
    chain = team.plans(rolling, [BALL], [team.member("bob", 3.0)])["ball"].chain
    assert chain is not None
    place = as_observed(chain, rolling.world).calls[0].goal.pose
    assert (place.x, place.y) == (0.1, 0.0)


def test_no_two_robots_are_sent_to_places_closer_than_their_sizes(team: Team) -> None:
    beside = dataclasses.replace(LEFT, name="beside", steps=(RoleStep("goToPose", x=0.3, y=2.0),))
    found = team.decide([team.member("ann", -1.0), team.member("bob", 1.0)], [LEFT, beside])
    assert [name for name in found.names if found.waits(name)] == ["bob"]


def test_a_robot_bids_where_it_ends(team: Team) -> None:
    bid = team.plans(team.member("ann", 1.0), [LEFT])["left"].bid
    assert bid is not None
    assert bid.end == pytest.approx((0.0, 2.0))


def test_the_frame_of_the_roles_may_differ_from_that_of_the_robots(team: Team) -> None:
    ann = team.member("ann", 1.0)
    plan = team.plans(ann, [LEFT], origin=Pose(1.0, 0.0, math.pi / 2.0))["left"]
    assert goal_of(plan) == pytest.approx(Pose(-1.0, 0.0, math.pi / 2.0))


def test_goals_beside_an_object_stay_in_the_area(team: Team) -> None:
    corner = ObjectState(-3.9, 2.4)
    role = Role("behind", (RoleStep("goToPose", at="ball", x=-1.0, y=1.0),))
    x, y, _ = goal_of(team.plans(team.member("ann", 1.0, ball=corner), [role])["behind"])
    area = team.library.robot.scene.area
    assert abs(x) < area.length / 2.0
    assert abs(y) < area.width / 2.0


def test_the_ball_is_where_the_robots_observe_it_in_the_mean(team: Team) -> None:
    members = [
        team.member(name, 1.0, ball=ball)
        for name, ball in (("ann", MIDDLE), ("bob", ObjectState(0.2, -0.4)), ("eve", None))
    ]
    found = common_objects(members, team.library.robot)["ball"]
    assert (found.x, found.y) == pytest.approx((0.1, -0.2))


def test_a_ball_that_a_robot_carries_does_not_roll_ahead_of_it(team: Team) -> None:
    ann = team.member("ann", 1.0, role="carry")
    hold = team.library.robot.hold_point(ann.world.robot.pose)
    carried = ObjectState(hold.x, hold.y, -0.5, 0.0)  # ann drives towards the middle
    holding = team.member("ann", 1.0, role="carry", ball=carried)
    ahead = team.member("bob", -1.0, ball=carried)
    role = Role("carry", (*BALL.steps, RoleStep("dribbleBall", x=-3.0)))
    assert team.roles([holding, ahead], [role]) == {"ann": "carry"}
    assert tops_of(team.plans(holding, [role], [ahead])["carry"]) == ["dribbleBall"]
    assert common_objects([ahead], team.library.robot)["ball"].x < hold.x - 0.1


@pytest.mark.parametrize("name", ["soccer"])
def test_shipped_roles_can_be_taken(team: Team, name: str) -> None:
    file = resource_path("config") / "team" / f"{name}.yaml"
    roles = list(load_roles(file, team.library, team.tools.domain.objects).roles)
    members = [
        team.member("ann", -2.0),
        team.member("bob", 1.0, 1.0),
        team.member("eve", 1.0, -1.0),
    ]
    bidding = team.bidding(members, roles)
    assert all(len(each.bids) == len(roles) for each in bidding)
    assert decide(bidding, roles).waiting == (False, False, False)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("roles: []", "roles: expected at least one"),
        ("roles: [{name: a, steps: []}]", "expected at least one"),
        ("roles: [{name: a, steps: [{top: fly}]}]", "roles[0]: top: expected one of"),
        ("roles: [{name: a, steps: [{top: goToPose, at: cart}]}]", "at: expected one of"),
        ("roles: [{name: a, steps: [{top: goToPose, open: [z]}]}]", "open: expected some of"),
        (
            "roles: [{name: a, steps: [{top: goToPose}]}, {name: a, steps: [{top: goToPose}]}]",
            "expected different names",
        ),
    ],
)
def test_a_wrong_file_is_refused_with_the_reason(
    team: Team, tmp_path: Path, text: str, reason: str
) -> None:
    file = tmp_path / "roles.yaml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(FileError) as error:
        load_roles(file, team.library, ("ball",))
    assert reason in str(error.value)
