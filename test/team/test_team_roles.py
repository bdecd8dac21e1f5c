"""Who takes which role: soccer with the shipped models, and the file of roles."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from ator_ros.evaluation.toolset import Toolset, ToolsetSource, tools_of
from ator_ros.files import FileError
from ator_ros.geometry import Pose
from ator_ros.refinement.chain_prediction import ChainModel, error_of_sum
from ator_ros.refinement.gate import Gate
from ator_ros.refinement.objective import Objective
from ator_ros.resources import resource_path
from ator_ros.team.role_file import Role, RoleStep, load_roles
from ator_ros.team.roles import Course, Decision, Member, as_observed, common_objects, decide
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
        return Member(name, World(0.0, RobotState(pose), objects), frozenset(self.library), role)

    def decide(self, members: list[Member], roles: list[Role], **options: Pose) -> Decision:
        return decide(members, roles, self.tools.refiner(), self.library, **options)

    def roles(self, members: list[Member], roles: list[Role]) -> dict[str, str]:
        """Return the role of each robot that has one."""
        found = self.decide(members, roles)
        numbers = {name: found.role_of(name) for name in found.names}
        return {name: roles[role].name for name, role in numbers.items() if role is not None}


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


def test_a_robot_in_its_role_goes_on_as_was_predicted_when_it_began(team: Team) -> None:
    ann = team.member("ann", -2.0, role="ball")
    left = team.decide([ann], [BALL]).costs[0, 0] - 1.0
    here = ((MIDDLE.x, MIDDLE.y),)
    going = dataclasses.replace(ann, course=Course(here, left))
    assert team.decide([going], [BALL]).costs[0, 0] == pytest.approx(left)
    elsewhere = dataclasses.replace(ann, course=Course(((3.0, 0.0),), left))
    assert team.decide([elsewhere], [BALL]).costs[0, 0] == pytest.approx(left + 1.0)
    other = dataclasses.replace(going, role="left")
    assert team.decide([other], [BALL]).costs[0, 0] == pytest.approx(left + 1.0)


def test_equal_costs_are_decided_by_name(team: Team) -> None:
    members = [team.member("bob", 1.5), team.member("ann", 1.5)]
    assert team.roles(members, [BALL]) == {"ann": "ball"}


def test_a_robot_without_a_top_or_without_the_ball_does_not_get_the_role(team: Team) -> None:
    near = team.member("bob", 1.0, role="ball")
    far = team.member("ann", -3.0)
    unable = dataclasses.replace(near, tops=frozenset({"goToPose"}))
    assert team.roles([far, unable], [BALL, LEFT]) == {"ann": "ball", "bob": "left"}
    blind = team.member("bob", 1.0, role="ball", ball=None)
    assert team.roles([far, blind], [BALL, LEFT]) == {"ann": "ball", "bob": "left"}


def test_a_robot_does_not_get_a_role_that_it_must_not_take(team: Team) -> None:
    near = dataclasses.replace(team.member("bob", 1.0, role="ball"), barred=frozenset({"ball"}))
    assert team.roles([team.member("ann", -3.0), near], [BALL]) == {"ann": "ball"}


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
        found = team.decide([team.member("ann", x)], [role])
        chain = found.chain_of("ann")
        assert chain is not None
        assert chain.calls[0].goal.pose.x == pytest.approx(math.copysign(1.0, x))


def test_a_robot_goes_on_to_an_alternative_that_is_no_longer_the_best(team: Team) -> None:
    behind = RoleStep("goToPose", at="ball", x=-1.0, open=("yaw",))
    role = Role("beside", (behind,), ((dataclasses.replace(behind, x=1.0),),))
    running = team.decide([team.member("ann", -2.0)], [role]).chain_of("ann")
    assert running is not None
    later = team.decide([team.member("ann", 2.0)], [role])
    assert later.goes_on("ann", running, 0.1)
    moved = team.decide([team.member("ann", 2.0, ball=ObjectState(0.2, 0.0))], [role])
    assert not moved.goes_on("ann", running, 0.1)


def test_steps_that_are_done_cost_nothing(team: Team) -> None:
    robot = team.library.robot
    ann = team.member("ann", 1.0)
    hold = robot.hold_point(ann.world.robot.pose)
    holding = team.member("ann", 1.0, ball=ObjectState(hold.x, hold.y))
    assert team.decide([holding], [BALL]).costs[0, 0] == 0.0
    further = Role("carry", (*BALL.steps, RoleStep("dribbleBall", x=2.0)))
    chain = team.decide([holding], [further]).chain_of("ann")
    assert chain is not None
    assert [call.top.name for call in chain.calls] == ["dribbleBall"]


def test_a_robot_at_a_place_with_an_open_heading_is_done(team: Team) -> None:
    here = Role("here", (RoleStep("goToPose", x=1.0, open=("yaw",)),))
    assert team.decide([team.member("ann", 1.0)], [here]).costs[0, 0] == 0.0


def test_the_robot_is_sent_to_the_ball_that_it_observes(team: Team) -> None:
    rolling = ObjectState(0.1, 0.0, 0.5, 0.0)
    members = [team.member("ann", -1.0, ball=rolling), team.member("bob", 3.0)]
    chain = team.decide(members, [BALL]).chain_of("ann")
    assert chain is not None
    place = as_observed(chain, members[0].world).calls[0].goal.pose
    assert (place.x, place.y) == (0.1, 0.0)


def test_no_two_robots_are_sent_to_places_closer_than_their_sizes(team: Team) -> None:
    beside = dataclasses.replace(LEFT, name="beside", steps=(RoleStep("goToPose", x=0.3, y=2.0),))
    found = team.decide([team.member("ann", -1.0), team.member("bob", 1.0)], [LEFT, beside])
    assert sorted(name for name in found.names if found.chain_of(name) is None) == ["bob"]


def test_the_frame_of_the_roles_may_differ_from_that_of_the_robots(team: Team) -> None:
    ann = team.member("ann", 1.0)
    found = team.decide([ann], [LEFT], origin=Pose(1.0, 0.0, math.pi / 2.0)).chain_of("ann")
    assert found is not None
    assert found.calls[0].goal.pose == pytest.approx(Pose(-1.0, 0.0, math.pi / 2.0))


def test_goals_beside_an_object_stay_in_the_area(team: Team) -> None:
    corner = ObjectState(-3.9, 2.4)
    role = Role("behind", (RoleStep("goToPose", at="ball", x=-1.0, y=1.0),))
    found = team.decide([team.member("ann", 1.0, ball=corner)], [role]).chain_of("ann")
    assert found is not None
    x, y, _ = found.calls[0].goal.pose
    area = team.library.robot.scene.area
    assert abs(x) < area.length / 2.0
    assert abs(y) < area.width / 2.0


def test_the_ball_is_where_the_robots_observe_it_in_the_mean(team: Team) -> None:
    worlds = [
        team.member("ann", 1.0, ball=ball).world for ball in (MIDDLE, ObjectState(0.2, -0.4), None)
    ]
    found = common_objects(worlds, team.library)["ball"]
    assert (found.x, found.y) == pytest.approx((0.1, -0.2))


def test_a_ball_that_a_robot_carries_does_not_roll_ahead_of_it(team: Team) -> None:
    ann = team.member("ann", 1.0, role="carry")
    hold = team.library.robot.hold_point(ann.world.robot.pose)
    carried = ObjectState(hold.x, hold.y, -0.5, 0.0)  # ann drives towards the middle
    holding = team.member("ann", 1.0, role="carry", ball=carried)
    ahead = team.member("bob", -1.0, ball=carried)
    role = Role("carry", (*BALL.steps, RoleStep("dribbleBall", x=-3.0)))
    found = team.decide([holding, ahead], [role])
    chain = found.chain_of("ann")
    assert chain is not None
    assert [call.top.name for call in chain.calls] == ["dribbleBall"]
    assert common_objects([ahead.world], team.library)["ball"].x < hold.x - 0.1


def test_the_uncertainty_of_a_difference_is_at_most_the_sum_of_both(team: Team) -> None:
    members = [team.member("ann", -2.0, role="ball"), team.member("bob", 1.98)]
    found = team.decide(members, [BALL])
    assert found.assignment.gain > 0.0
    assert 0.0 < found.assignment.uncertainty <= found.errors.sum() + 1e-9


def test_the_same_drive_twice_differs_for_certain(team: Team) -> None:
    model = ChainModel(
        team.member("ann", -2.0).world,
        BALL.chains(team.library, {"ball": MIDDLE}, Pose(0.0, 0.0, 0.0))[0],
        team.library.robot,
        models=team.tools.models,
        names=[()],
        objective=Objective(),
    )
    assert error_of_sum([model, model], [1.0, -1.0]) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert math.hypot(*error_of_sum([model], [1.0])) == pytest.approx(model.predict().error)


@pytest.mark.parametrize("name", ["soccer"])
def test_shipped_roles_can_be_taken(team: Team, name: str) -> None:
    file = resource_path("config") / "team" / f"{name}.yaml"
    roles = list(load_roles(file, team.library, team.tools.domain.objects).roles)
    members = [
        team.member("ann", -2.0),
        team.member("bob", 1.0, 1.0),
        team.member("eve", 1.0, -1.0),
    ]
    found = team.decide(members, roles)
    assert np.isfinite(found.costs).all()
    assert found.waiting == (False, False, False)


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
