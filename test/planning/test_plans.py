"""Plans from goals: valid chains, or the reasons why there is none."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import pytest

from ator_ros.bases.description import Robot
from ator_ros.domains.domain import Domain, find_domain
from ator_ros.execution.fence import Fence
from ator_ros.geometry import Pose
from ator_ros.planning.goals import GoalStatement, PlanningError, statement_from
from ator_ros.planning.planner import chains_for
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


def near_goal(x: float, y: float) -> TopChain:
    """Return the chain that places the ball before a shot, with the ball at (x, y) m."""
    chains = planned(IN_GOAL, situation(robot=Pose(x - 1.0, y, 0.0), ball=(x, y)))
    return next(chain for chain in chains if len(chain) == 3)


@pytest.mark.parametrize("place", [(0.0, 0.0), (-2.0, 1.5), (1.0, -2.0), (2.0, 0.3), (3.3, 0.0)])
def test_the_place_before_a_shot_is_the_nearest_that_keeps_the_tolerance(
    place: tuple[float, float],
) -> None:
    chain = near_goal(*place)
    there = chain.calls[1].goal.pose
    now = Pose(*place, 0.0)
    shot = chain.calls[2]
    pre = shot.top.pre
    margin = chain.calls[1].top.place_tolerance

    def clearance(x: float, y: float) -> float:
        goal = {"x": shot.goal.pose.x, "y": shot.goal.pose.y}
        return min(
            float(relation.clearance({"ball.x": x, "ball.y": y}, goal))
            for relation in pre.relations
        )

    assert clearance(there.x, there.y) >= margin - 1e-9
    assert there.distance(now) >= 0.5
    rng = np.random.default_rng(2)
    for x, y in rng.uniform((-4.0, -2.5), (4.0, 2.5), (2000, 2)):
        if clearance(x, y) >= margin + 0.1 and math.hypot(x - now.x, y - now.y) >= 0.6:
            assert math.hypot(x - now.x, y - now.y) >= there.distance(now) - 0.15


def test_at_the_chosen_place_the_robot_heads_for_the_target_of_the_next_step() -> None:
    chain = near_goal(0.0, 1.0)
    _, dribble, shot = (call.goal.pose for call in chain.calls)
    toward = math.atan2(shot.y - dribble.y, shot.x - dribble.x)
    assert dribble.yaw == pytest.approx(toward)


def test_other_headings_are_along_the_approach() -> None:
    (chain,) = planned(statements_of("ball.x=2", "ball.y=1"), situation(ball=(1.0, 0.0)))
    fetch, dribble = chain.calls
    assert fetch.goal.pose[:2] == (1.0, 0.0)
    assert fetch.goal.pose.yaw == pytest.approx(math.atan2(-1.0, 3.0))
    axle = fetch.goal.robot_pose(ROBOT)
    assert dribble.goal.pose[:2] == (2.0, 1.0)
    assert dribble.goal.pose.yaw == pytest.approx(math.atan2(1.0 - axle.y, 2.0 - axle.x))
    (chain,) = planned(statements_of("robot.yaw=1"), situation())
    (turn,) = chain.calls
    assert turn.goal.pose == Pose(START.x, START.y, 1.0)
    already = statements_of("robot.x=-2", "robot.y=1", "robot.vx=0")
    assert planned(already, situation()) == []


def test_what_the_goal_leaves_free_is_open_and_only_the_last_step_stops() -> None:
    (chain,) = planned(statements_of("ball.x=2", "ball.y=1"), situation())
    assert [sorted(call.open) for call in chain.calls] == [["speed", "yaw"], ["yaw"]]
    (chain,) = planned(statements_of("robot.x=1", "robot.yaw=0.5"), situation())
    (drive,) = chain.calls
    assert sorted(drive.open) == ["y"]
    assert drive.goal.pose == Pose(1.0, START.y, 0.5)


def test_an_unreachable_combination_is_explained() -> None:
    wanted = statements_of("robot.x=3", "robot.y=0", "ball.x=-3", "ball.y=0", "hold.x=-3")
    with pytest.raises(PlanningError, match=r"each condition can be achieved, but no sequence"):
        planned(wanted, situation())


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


def test_invalid_statements_are_rejected() -> None:
    for text in ("ball.x", "=1", "ball.x=1:2", "ball.x=nan", "ball.x=1:a:b", "ball.x=1:2:1"):
        with pytest.raises(PlanningError, match="goal: "):
            statement_from(text)
