"""Plans from goals: valid chains, or the reasons why there is none."""

import dataclasses
import math
from collections.abc import Sequence

import pytest

from ator_ros.bases.description import Robot
from ator_ros.domains.domain import Domain, find_domain
from ator_ros.execution.fence import Fence
from ator_ros.geometry import Pose
from ator_ros.planning.goals import GoalStatement, PlanningError, statement_from
from ator_ros.planning.planner import chains_for
from ator_ros.tools.plan import main as plan_main
from ator_ros.tops.chain import TopChain
from ator_ros.world.state import ObjectState, RobotState, World

SOCCER = find_domain("soccer")
ROBOT = SOCCER.robot()
IN_GOAL = SOCCER.goals(ROBOT)["ball_in_goal"].terms


START = Pose(-2.0, 1.0, 0.0)


def situation(*, robot: Pose = START, ball: tuple[float, float] | None = (0.0, 0.0)) -> World:
    return World(0.0, RobotState(robot), {} if ball is None else {"ball": ObjectState(*ball)})


def planned(
    goal: Sequence[GoalStatement],
    world: World,
    *,
    domain: Domain = SOCCER,
    robot: Robot = ROBOT,
    fence: Fence | None = None,
) -> list[TopChain]:
    return chains_for(goal, world, domain.library(robot), domain.objects, fence)


def tops(chains: Sequence[TopChain]) -> set[tuple[str, ...]]:
    return {tuple(call.top.name for call in chain.calls) for chain in chains}


def statements_of(*statements: str) -> list[GoalStatement]:
    return [statement_from(text) for text in statements]


FROM_HERE = ("goToBall", "shoot")
ANYWHERE = ("goToBall", "dribbleBall", "shoot")


def test_a_ball_far_from_the_goal_is_dribbled_first() -> None:
    (chain,) = planned(IN_GOAL, situation())
    assert tops([chain]) == {ANYWHERE}
    assert [sorted(call.open) for call in chain.calls] == [
        ["speed", "yaw"],
        ["speed", "x", "y", "yaw"],
        [],
    ]
    assert chain.calls[2].goal.pose[:2] == (4.0, 0.0)


def test_a_ball_near_the_goal_is_shot_from_two_places() -> None:
    world = situation(robot=Pose(3.4, 1.0, math.pi), ball=(2.4, 0.5))
    chains = planned(IN_GOAL, world)
    assert tops(chains) == {FROM_HERE, ANYWHERE}
    assert all(not chain.violations(world, ROBOT) for chain in chains)
    assert [len(chain) for chain in chains] == sorted(len(chain) for chain in chains)


def test_a_held_ball_is_not_fetched() -> None:
    ball = ROBOT.hold_point(Pose(2.0, 0.0, 0.0))
    world = situation(robot=Pose(2.0, 0.0, 0.0), ball=(ball.x, ball.y))
    assert tops(planned(IN_GOAL, world)) == {("shoot",), ("dribbleBall", "shoot")}


def test_an_achieved_goal_needs_no_chain() -> None:
    assert planned(statements_of("ball.x=0:-0.1:0.1"), situation()) == []


@pytest.mark.parametrize(
    ("statements", "steps"),
    [
        (("ball.x=1", "ball.y=1"), {("goToBall", "dribbleBall")}),
        (("ball.x=hold.x", "ball.y=hold.y"), {("goToBall",)}),
        (("robot.x=1", "robot.y=1", "robot.yaw=1"), {("goToPose",)}),
        (
            ("ball.x=1", "ball.y=1", "robot.x=-1", "robot.y=-1"),
            {("goToBall", "dribbleBall", "goToPose")},
        ),
    ],
)
def test_statements_are_achieved(statements: tuple[str, ...], steps: set[tuple[str, ...]]) -> None:
    assert tops(planned(statements_of(*statements), situation())) == steps


@pytest.mark.parametrize(
    ("statements", "reason"),
    [
        (("ball.x=1:-0.01:0.01",), "no TOP achieves ball.x -0.01 to 0.01 of 1"),
        (("cup.x=1",), "expected one of robot.x, "),
        (
            ("ball.x=99",),
            "chain.calls[1].goal (dribbleBall): expected a place for the robot inside the fence (x",
        ),
        (("ball.x=1", "ball.x=2"), "expected each variable once, got ball.x twice"),
    ],
)
def test_an_unachievable_variable_is_reported(statements: tuple[str, ...], reason: str) -> None:
    with pytest.raises(PlanningError) as refused:
        planned(statements_of(*statements), situation())
    assert reason in str(refused.value)
    assert "\n" not in str(refused.value)


def test_an_unknown_object_is_reported() -> None:
    with pytest.raises(PlanningError, match="goToBall needs the ball, which is unknown"):
        planned(IN_GOAL, situation(ball=None))


def test_only_the_fence_bounds_plans() -> None:
    there = situation(robot=Pose(0.0, 8.0, 0.0), ball=(9.0, 0.0))
    with pytest.raises(
        PlanningError, match=r"^chain\.calls\[0\]\.goal \(goToBall\): .*inside the fence"
    ):
        planned(IN_GOAL, there)
    with pytest.raises(PlanningError, match=r"inside the fence .* got the axle at x 12\.00 m"):
        planned(statements_of("robot.x=12", "robot.y=0"), there)
    wide = Fence(-20.0, -20.0, 20.0, 20.0)
    assert tops(planned(statements_of("robot.x=12", "robot.y=0"), there, fence=wide)) == {
        ("goToPose",)
    }
    assert planned(IN_GOAL, there, fence=wide)
    # may enter
    assert tops(planned(statements_of("robot.x=1", "robot.y=0"), there)) == {("goToPose",)}


def test_places_are_searched_inside_a_narrow_fence() -> None:
    world, narrow = situation(ball=(0.0, 1.5)), Fence(-4.0, 1.0, 4.0, 3.0)
    places = [
        planned(IN_GOAL, world, fence=fence)[0].calls[1].goal.pose.y for fence in (None, narrow)
    ]
    assert places[0] < 1.0 < places[1]
    with pytest.raises(PlanningError, match="expected a place for it in the area, found none"):
        planned(IN_GOAL, situation(), fence=Fence(-4.0, -2.0, 1.6, 2.0))


def test_without_a_holder_the_missing_condition_is_reported() -> None:
    bare = dataclasses.replace(ROBOT, holder=None)
    with pytest.raises(PlanningError, match="needs a holder"):
        planned(statements_of("ball.x=1", "ball.y=1"), situation(), robot=bare)


def test_an_unachievable_precondition_is_reported() -> None:
    library = SOCCER.library(ROBOT)
    one = dataclasses.replace(
        SOCCER, tops=tuple(top for top in library.values() if top.name == "shoot")
    )
    with pytest.raises(PlanningError) as refused:
        planned(IN_GOAL, situation(ball=(2.4, 0.0)), domain=one)
    assert "no TOP achieves hold.x within 0.12 of ball.x, which shoot needs" in str(refused.value)


def test_the_tool_prints_chains_and_predictions(capsys: pytest.CaptureFixture[str]) -> None:
    words = ("ball_in_goal", "--at", "3.4", "1", "3.14", "--object", "ball", "2.4", "0.5")
    assert plan_main(words) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2
    durations = [float(line.split()[0]) for line in lines]
    assert durations == sorted(durations)
    assert plan_main([]) == 0
    assert "ball_in_goal" in capsys.readouterr().out
    assert plan_main(["ball_in_goal"]) == 1
    refused = capsys.readouterr().err
    assert refused.startswith("plan: goToBall needs the ball, which is unknown; ")
    assert "no TOP achieves ball.x " in refused
    assert refused.count("\n") == 1


def test_invalid_statements_are_rejected() -> None:
    for text in ("ball.x", "=1", "ball.x=1:2", "ball.x=nan", "ball.x=1:a:b", "ball.x=1:2:1"):
        with pytest.raises(PlanningError, match="goal: "):
            statement_from(text)
